"""Finished solutions of other programs: read into one form, and written in theirs.

Converts every frame and pixel origin once, exactly; adjusts nothing, and keeps silent about nothing it cannot hold.
`recognition.read_solution`, and one module or room for each program.
"""
