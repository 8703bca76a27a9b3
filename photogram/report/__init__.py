"""The report of a survey: report.json, its page, its figures, the 3-D page.

Reads results and the block; estimates nothing, and draws only what report.json and the products hold.
`page`; rooms `view`, `numbers` and `figures`.
"""
