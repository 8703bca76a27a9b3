"""What the terminal shows: tables, progress, findings.

Formats; decides and computes nothing.
`terminal`, `stage_lines`, `report_tables`.
"""
