"""Files of two epochs: clouds to compare, and what a comparison writes.

Reads and writes; compares nothing.
`compared_clouds`, `change_files`.
"""
