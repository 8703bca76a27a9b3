"""Finished solutions of other programs, adjusted again from their own measurements, and both side by side.

Knows no file format and prints nothing: `photogram.exchange.formats` reads, `photogram.exchange.work` shows.
`foreign_block.foreign_block` and `audit.audited`.
"""
