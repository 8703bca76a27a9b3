"""The client's part of the report page: what a reader who signs wants to know, in four printed pages.

Every figure is taken from report.json, and says from which key.
"""
