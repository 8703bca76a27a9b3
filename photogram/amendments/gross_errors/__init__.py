"""Gross errors: a robust look before the adjustment, data snooping after it, and what went wrong in words.

Rejects only what the test statistics support, and names it with the alternatives that explain as much.
`data_snooping.search`.
"""
