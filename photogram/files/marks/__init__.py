"""Marks of ground points in photographs: what a mark is, its tables, and the files of other programs.

Keeps and converts what was marked; measures nothing in photographs, and decides nothing about weights or roles.
`marks.Mark`, `mark_table` and `formats`.
"""
