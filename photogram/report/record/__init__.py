"""The types of report.json, section by section: keys, units, and what may be null.

Holds no rule and computes nothing; every key is described in docs/report.md.
`report.Report` is the whole file; `json_schema` the same for other programs.
"""
