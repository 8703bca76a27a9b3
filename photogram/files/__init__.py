"""File formats, one module each: what the project and the products are read from and written to.

Converts between bytes and the types of the ground floor; computes nothing, and knows neither project nor stages.
`atomic.replacing` writes a file whole or not at all; `photographs`, `clouds`, `maps` and `tables` hold the formats.
"""
