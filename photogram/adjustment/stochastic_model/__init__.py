"""The stochastic model: variance components, tested and applied, of tie points and of assumed GNSS sigmas.

Minimises nothing, and changes no sigma that somebody stated, but those of tie points.
`estimated_sigmas.improved`, `assumed_sigmas.assumed_scatters`, `variance_components.variance_components`.
"""
