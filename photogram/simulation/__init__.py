"""Surveys that were never flown: simulated with known truth, or planned and predicted.

Uses no estimate as truth; nothing here takes part in a real survey.
`simulated_survey.simulate`, `demonstration`; room `planning`.
"""
