"""Gross errors: search before the adjustment, data snooping after it, and a wrong focal length as an alternative.

Rejects only what the test statistics support, and names it with the alternatives that explain as much.
`snooped_adjustment.adjust_with_snooping`.
"""
