"""The client's part of the report page: what a reader who signs wants to know, in four printed pages.

Takes every figure from report.json and says from which key; computes and judges none.
`contents.client_part`.
"""
