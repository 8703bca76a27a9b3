"""The drawings of the report: maps, profiles, plots.

Draws the numbers of report.json and the products; computes no new ones.
`page_figures` lists what the page shows.
"""
