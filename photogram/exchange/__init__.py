"""Other programs' solutions: imported, exported, and adjusted again beside their own figures.

Nothing is approximated silently: what a format cannot hold is refused or named.
`solution_import.import_solution`, `solution_export.export_solution`; rooms `formats`, `audit`.
"""
