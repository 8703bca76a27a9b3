"""What `photogram deliver` does."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from photogram.delivery.hand_over import deliver
from photogram.delivery.names import Product
from photogram.terminal.console import console


def run(
    project: Path,
    products: Sequence[Product],
    output: Path | None,
    tolerance_m: float | None,
    surface_error_m: float | None,
    photographs: Path | None,
    *,
    package: bool,
) -> None:
    """Write the products, and say of each where it is, what it holds and what it does not."""
    made = deliver(
        project,
        products,
        output,
        tolerance_m=tolerance_m,
        surface_error_m=surface_error_m,
        photographs=photographs,
        package=package,
    )
    for delivered in made:
        if delivered.holds:
            console.print(f"Written: {escape(str(delivered.path))}: {escape(delivered.holds)}", soft_wrap=True)
        for sentence in delivered.left_out:
            lead = "Not in it" if delivered.holds else "Not written"
            console.print(f"{lead}: {escape(sentence)}", soft_wrap=True, highlight=False)
