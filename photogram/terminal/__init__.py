"""What commands share: arguments, checks before the work, progress, tables, events, exit codes.

Formats and shows; decides and computes nothing, and knows no command.
`console`, `progress`, `report_tables`, `exit_codes`.
"""
