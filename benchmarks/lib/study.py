"""What studies of simulated surveys have in common: their arguments, processes, statistics, and tables.

A script makes its arguments with ``parser``, has its trials done by ``run``, and prints rows of a ``Table`` within
``recorded``, which writes the same tables as JSON.
"""

import argparse
import io
import json
import math
import multiprocessing
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager, redirect_stdout
from functools import cache
from pathlib import Path
from typing import TypedDict, TypeVar
from unittest.mock import patch

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2, kstest

from photogram.arrays import FloatArray

CaseT = TypeVar("CaseT")
RowT = TypeVar("RowT")

WORKERS = 2
SIGMAS = (1.0, 2.0, 3.0)
EXPECTED_SHARES = tuple(math.erf(limit / math.sqrt(2.0)) for limit in SIGMAS)
"""Of normal errors within SIGMAS standard deviations."""
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_RULE = re.compile(r"\|(?:\s*:?-+:?\s*\|)+")


class PrintedTable(TypedDict):
    """A table as it was printed: the texts of its columns' titles and of its cells."""

    columns: list[str]
    rows: list[list[str]]


def parser(doc: str | None, seeds: int, first: int = 0, workers: int = WORKERS) -> argparse.ArgumentParser:
    """Return the arguments of a study: ``seeds`` (a range from ``first`` on, of so many), ``workers``, ``json``."""

    def seeds_from_first(text: str) -> range:
        return range(first, first + int(text))

    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("seeds", nargs="?", type=seeds_from_first, default=str(seeds), help=f"how many, default {seeds}")
    made.add_argument("--workers", type=int, default=workers, help=f"processes, default {workers}")
    made.add_argument("--json", type=Path, metavar="FILE", help="write the printed tables here, too")
    return made


@cache
def _pool(workers: int) -> ProcessPoolExecutor:
    """Return processes that begin anew; the interpreter ends them with itself."""
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))


def run(trial: Callable[[CaseT], RowT], cases: Sequence[CaseT], workers: int = WORKERS) -> list[RowT]:
    """Return the row of each case, a seed as a rule, in their order, done by processes of one thread each.

    ``trial`` is a function of a module, or a partial of one. Raises what it raises, and does no other case then.
    """
    began = time.monotonic()
    with patch.dict(os.environ, ONE_THREAD):
        futures = [_pool(workers).submit(trial, case) for case in cases]
    try:
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            if sys.stderr.isatty():
                text = f"\r{done} of {len(cases)}, {time.monotonic() - began:.0f} s"
                print(text, end="\n" if done == len(cases) else "", file=sys.stderr, flush=True)
    finally:
        for future in futures:
            future.cancel()
    return [future.result() for future in futures]


def rms(values: ArrayLike) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


def normalised_squares(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return eᵀ Σ⁻¹ e / k (N,) of errors (N, k) with covariances (N, k, k); its expectation is 1."""
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", error, solved) / error.shape[1])


def mean_square_bounds(count: int, probability: float = 0.99) -> tuple[float, float]:
    """Return between which bounds the mean square of so many standard normal values lies with a probability (χ²)."""
    tail = (1.0 - probability) / 2.0
    low, high = (float(chi2.ppf(share, count)) / count for share in (tail, 1.0 - tail))
    return low, high


def shares_within(z: ArrayLike, limits: Sequence[float] = SIGMAS) -> FloatArray:
    """Return the share of errors over their standard deviations within each limit; see EXPECTED_SHARES."""
    size = np.abs(np.asarray(z, dtype=np.float64))
    return np.array([np.mean(size <= limit) for limit in limits])


def kolmogorov_smirnov_p(values: ArrayLike, distribution: str) -> float:
    """Return the probability that values of a distribution ("norm", "uniform") are as far from it as these."""
    return float(kstest(np.asarray(values, dtype=np.float64), distribution).pvalue)


class Table:
    """A table in Markdown, in columns as wide as their titles at least: the same on a page and in a terminal."""

    def __init__(self, *titles: str) -> None:
        self._widths = [max(3, len(title)) for title in titles]
        self.row(*titles)
        print("|" + "|".join("-" * (width + 2) for width in self._widths) + "|")

    def row(self, *cells: object) -> None:
        """Print a row; cells are texts, or printed as they are."""
        texts = [str(cell).ljust(width) for cell, width in zip(cells, self._widths, strict=True)]
        print("| " + " | ".join(texts) + " |", flush=True)


def tables_of(text: str) -> list[PrintedTable]:
    """Return the tables in Markdown that a text has."""
    found: list[PrintedTable] = []
    before: list[str] = []
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if _RULE.fullmatch(line.strip()) and before:
            found.append({"columns": before, "rows": []})
            inside = True
        elif not line.startswith("|"):
            before, inside = [], False
        elif inside:
            found[-1]["rows"].append(cells)
        else:
            before = cells
    return found


class _Both(io.StringIO):
    """What is written to it goes to a stream, too."""

    def __init__(self, stream: io.TextIOBase) -> None:
        super().__init__()
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text to both."""
        self._stream.write(text)
        return super().write(text)

    def flush(self) -> None:
        """Flush the stream."""
        self._stream.flush()


@contextmanager
def recorded(path: Path | None) -> Iterator[None]:
    """Have what is printed written to a JSON file at the end, if there is to be one: ``text``, and its ``tables``."""
    both = _Both(sys.stdout)  # type: ignore[arg-type]
    with redirect_stdout(both):
        yield
    if path is not None:
        text = both.getvalue()
        path.write_text(json.dumps({"text": text, "tables": tables_of(text)}, ensure_ascii=False, indent=1) + "\n")
