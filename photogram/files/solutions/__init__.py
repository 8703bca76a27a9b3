"""Solutions of other programs as data, stored beside a project that starts from one.

Knows the format of no other program.
`solution`, `stored_solutions`.
"""
