"""The reference engine: GTSAM's graph with every tie point a variable and every observation a factor; slow.

Needs GTSAM, which nothing else does but a solver of `elimination`; imported where it is asked for alone.
`graph.ReferenceSystem`, `graph.ground_graph`, `graph.linearise_all`, `native.in_gtsam`.
"""
