"""The products that are handed over and their files, for the command, which imports nothing that computes."""

from enum import StrEnum


class Product(StrEnum):
    """What is handed over."""

    DXF = "dxf"


FILES = {Product.DXF: "survey.dxf"}
"""The file of each product."""
