"""What a survey will take, said before the work: time, disk and memory of each stage.

Predicts; runs no stage, and keeps nothing outside the work folder.
`forecast.forecast`; the parts are `workload`, `rates`, `self_test` and `earlier_runs`.
"""
