"""The factors of the joint adjustment, and the engines that minimise it: GTSAM's, and our own in `elimination`.

The only room that knows GTSAM; knows no files, no project and no quality measures.
`graph` builds the factor graph, `minimisation` solves it, `covariance` gives its covariances.
"""
