"""The data flow: which stages make a survey, in which order, and what is stored between them.

Computes nothing of its own; stages call the rooms below and store what they return.
`pipeline.load_project`, `pipeline.run_pipeline`, `pipeline.open_run`.
"""
