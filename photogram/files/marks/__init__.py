"""Marks of ground points in photographs: their tables, and the files of other programs.

Keeps and converts what was marked; measures nothing in photographs, and decides nothing about weights or roles.
`mark_table` and `formats`.
"""
