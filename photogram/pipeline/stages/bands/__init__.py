"""The bands of companions as an orthophoto of their own, and how well they lie on the master's.

Knows no report, and writes into the folder that it is given.
`band_orthophoto.make_bands`, `band_orthophoto.band_records`.
"""
