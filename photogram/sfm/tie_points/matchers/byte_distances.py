"""Distances of rows of bytes by the processor's own instructions, for kernels compiled by numba.

Processors with VNNI (AVX-512 or AVX) multiply four pairs of bytes and add the products to a 32-bit number in one step,
in every lane: four times as many as they multiply in single precision, and exact. Those with AVX2 multiply two pairs of
16-bit numbers and add the products: twice as many. numba has no word for either, so a tile of the table of distances is
written here for LLVM: rows times columns, whose sums stay in registers until the smallest of every row and column are
known.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

from llvmlite import binding, ir
from numba import config, types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic

Value: TypeAlias = Any
"""What numba and llvmlite carry no types for: values of compiled code, types of theirs."""

PANELS = 2
"""Vectors of columns in a tile."""


@dataclass(frozen=True)
class Tile:
    """A tile of a table of distances: ``rows`` times PANELS vectors of ``lanes`` columns, all of which registers hold;
    in a lane so many numbers are multiplied ``together``, which fill 32 bits."""

    rows: int
    lanes: int
    together: int = 4

    @property
    def columns(self) -> int:
        """Return the number of columns."""
        return PANELS * self.lanes


WIDE, NARROW, PAIRS = Tile(12, 16), Tile(6, 8), Tile(6, 8, 2)
"""Tiles for VNNI of AVX-512 with its 32 registers and of AVX with its 16, and for AVX2 without VNNI."""


def usable_tiles() -> tuple[Tile, ...]:
    """Return the tiles for which this processor has the instruction, the best one first; none where it has neither, or
    where numba is told to compile for another processor."""
    if config.CPU_NAME not in (None, "host") or config.CPU_FEATURES is not None:
        return ()
    try:
        feature = binding.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know the processor
        return ()
    wide = bool(feature.get("avx512vnni"))
    narrow = bool(feature.get("avxvnni")) or (wide and bool(feature.get("avx512vl")))
    return (WIDE,) * wide + (NARROW,) * narrow + (PAIRS,) * bool(feature.get("avx2"))


def distances_of_tile(tile: Tile) -> Value:
    """Return a function for kernels that computes a tile of distances and takes its smallest into account.

    Its arguments are whole numbers, those in capitals addresses of arrays: ``function(ROWS, COLUMNS, groups, NORM,
    NORMS, place, top, BEST, SECOND, BACK, LEAST)``.

    - ROWS (R, groups, 4) signed bytes, COLUMNS (PANELS, groups, lanes, 4) unsigned bytes; or (R, groups, 2) and
      (PANELS, groups, lanes, 2) 16-bit numbers, where two are multiplied together;
    - NORM (R,) and NORMS (C,) uint32, whose sum less 512 times the product is a distance in units of 1/256;
    - BEST and SECOND (R, C) uint32: of every row, in every lane, the two smallest sums of distance and ``place``;
    - BACK and LEAST (C,) int32 and uint32: of every column the row of the smallest distance, counted from ``top`` in
      this tile, and that distance, whole.
    """

    def code(context: Value, builder: Value, _: Value, arguments: Value) -> Value:
        _Writer(builder, tile).write(*arguments)
        return context.get_dummy_value()

    def distances(  # the names of its arguments are those of _Writer.write
        _: Value, rows: Value, columns: Value, groups: Value, norm: Value, norms: Value, place: Value, top: Value,  # noqa: ARG001
        best: Value, second: Value, back: Value, least: Value,  # noqa: ARG001
    ) -> Value:  # fmt: skip
        address, number = types.uintp, types.intp
        signature = (address, address, number, address, address, number, number, *(address,) * 4)
        return types.void(*signature), code

    return intrinsic(distances)


_FOUR, _EIGHT = ir.IntType(32), ir.IntType(64)


class _Writer:
    """Writes the instructions for one tile."""

    def __init__(self, builder: Value, tile: Tile) -> None:
        self._builder, self._tile = builder, tile
        self._vector = ir.VectorType(_FOUR, tile.lanes)

    def write(
        self, rows: Value, columns: Value, groups: Value, norm: Value, norms: Value, place: Value, top: Value,
        best: Value, second: Value, back: Value, least: Value,
    ) -> None:  # fmt: skip
        """Write the sums of products, then what becomes of them."""
        b, tile = self._builder, self._tile
        sums = self._sums(rows, columns, groups)
        before = [self._load(norms, p) for p in range(PANELS)]
        place = self._everywhere(b.trunc(place, _FOUR))
        column = [self._number(-1)] * PANELS
        for r in range(tile.rows):
            own = self._everywhere(self._load(norm, r, _FOUR))
            for p in range(PANELS):
                product = b.shl(sums[r][p], self._number(9))
                distance = b.sub(b.add(own, before[p]), product)
                here, at = b.add(distance, place), PANELS * r + p
                smallest = self._load(best, at)
                self._store(self._least(smallest, here), best, at)
                larger = b.select(b.icmp_unsigned("<", smallest, here), here, smallest)
                self._store(self._least(self._load(second, at), larger), second, at)
                column[p] = self._least(column[p], b.add(distance, self._number(r)))
        top = self._everywhere(b.trunc(top, _FOUR))
        for p in range(PANELS):
            distance, row = b.lshr(column[p], self._number(8)), b.and_(column[p], self._number(255))
            known = self._load(least, p)
            nearer = b.icmp_unsigned("<", distance, known)
            self._store(b.select(nearer, distance, known), least, p)
            self._store(b.select(nearer, b.add(top, row), self._load(back, p)), back, p)

    def _sums(self, rows: Value, columns: Value, groups: Value) -> list[list[Value]]:
        """Write the loop over groups of numbers that are multiplied together, with one sum for every row and panel."""
        b, tile = self._builder, self._tile
        before, loop, after = b.block, b.append_basic_block("groups"), b.append_basic_block("sums")
        b.branch(loop)
        b.position_at_end(loop)
        group = b.phi(_EIGHT)
        running = [[b.phi(self._vector) for _ in range(PANELS)] for _ in range(tile.rows)]
        panel = [self._load(columns, b.add(b.mul(groups, _EIGHT(p)), group)) for p in range(PANELS)]
        total = []
        for r in range(tile.rows):
            four = self._everywhere(self._load(rows, b.add(b.mul(groups, _EIGHT(r)), group), _FOUR))
            total.append([self._with_products(running[r][p], panel[p], four) for p in range(PANELS)])
        following = b.add(group, _EIGHT(1))
        group.add_incoming(_EIGHT(0), before)
        group.add_incoming(following, loop)
        for r in range(tile.rows):
            for p in range(PANELS):
                running[r][p].add_incoming(self._number(0), before)
                running[r][p].add_incoming(total[r][p], loop)
        b.cbranch(b.icmp_signed("<", following, groups), loop, after)
        b.position_at_end(after)
        return total

    def _with_products(self, total: Value, column: Value, row: Value) -> Value:
        """Return a vector of sums with the products of a group added."""
        b, vector = self._builder, self._vector
        if self._tile.together == 4:
            name, kind = f"llvm.x86.avx512.vpdpbusd.{32 * self._tile.lanes}", ir.FunctionType(vector, [vector] * 3)
            return b.call(get_or_insert_function(b.module, kind, name), [total, column, row])
        pairs = ir.VectorType(ir.IntType(16), 2 * self._tile.lanes)
        products = get_or_insert_function(b.module, ir.FunctionType(vector, [pairs] * 2), "llvm.x86.avx2.pmadd.wd")
        return b.add(total, b.call(products, [b.bitcast(column, pairs), b.bitcast(row, pairs)]))

    def _number(self, value: int) -> Value:
        """Return a vector of one constant."""
        return ir.Constant(self._vector, [_FOUR(value)] * self._tile.lanes)

    def _everywhere(self, value: Value) -> Value:
        """Return a vector of one number."""
        b, none = self._builder, ir.Constant(self._vector, ir.Undefined)
        return b.shuffle_vector(b.insert_element(none, value, _FOUR(0)), none, self._number(0))

    def _least(self, one: Value, other: Value) -> Value:
        return self._builder.select(self._builder.icmp_unsigned("<", other, one), other, one)

    def _at(self, address: Value, index: Value, kind: Value) -> Value:
        index = _EIGHT(index) if isinstance(index, int) else index
        return self._builder.gep(self._builder.inttoptr(address, kind.as_pointer()), [index])

    def _load(self, address: Value, index: Value, kind: Value = None) -> Value:
        return self._builder.load(self._at(address, index, kind or self._vector), align=4)

    def _store(self, value: Value, address: Value, index: int) -> None:
        self._builder.store(value, self._at(address, index, self._vector), align=4)
