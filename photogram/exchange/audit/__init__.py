"""Finished solutions of other programs, adjusted again from their own measurements, and both beside each other.

Knows no file format and no page: `photogram.exchange.formats` reads, `photogram.cli` and `photogram.report` show.
`foreign_block.foreign_block` and `audit.audited`.
"""
