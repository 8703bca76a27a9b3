"""The joint adjustment of a block: problem, outliers, self-calibration, common errors, reliability.

Reads no files and knows nothing of projects; gives covariances, and leaves judging them to `quality`.
`adjustment.adjust` adjusts a block; `reliability.reliability` gives redundancy numbers and detectable blunders.
"""
