"""Pairs that are selected, and verified between strips, where flying heights are 0.3 to 2 times the truth.

    python benchmarks/pair_selection.py [BLOCK...]

For each block and factor: pairs selected, in parentheses those matched to find the depth of the ground, and verified
pairs between strips over those at right heights; before that the same without looking for the depth. Blocks are
simulated; two photographs count as verified where they truly share ground (benchmarks/lib/pair_blocks.py).
"""

import sys

from lib.pair_blocks import BLOCKS, selected, sharing

FACTORS = (1.0, 0.3, 0.5, 0.7, 1.4, 2.0)


def main(names: list[str]) -> None:
    """Print a line for each block and factor."""
    print(f"{'block':20} {'heights':>7} {'pairs':>7} {'across':>7}  {'with depth: pairs':>17} {'across':>7}")
    for name in names or list(BLOCKS):
        flown = BLOCKS[name]()
        truth = sharing(flown)
        right = selected(flown, truth, 1.0).verified_across
        for factor in FACTORS:
            plain, probed = selected(flown, truth, factor, probing=False), selected(flown, truth, factor)
            pairs = f"{len(probed.pairs)} ({probed.probed})"
            print(
                f"{name:20} {factor:7.1f} {len(plain.pairs):7d} {plain.verified_across / right:7.2f}  {pairs:>17} "
                f"{probed.verified_across / right:7.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
