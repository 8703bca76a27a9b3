"""File formats, one module each: what the project and the products are read from and written to.

Converts between bytes and the types of the ground floor; computes nothing, and knows neither project nor stages.
`atomic.replacing` writes whole; `photographs`, `clouds`, `maps`, `triangulations`, `tables`, `marks` hold the formats.
"""
