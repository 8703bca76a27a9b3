"""Focal lengths that are fixed, but whose uncertainty counts: consider parameters (Tapley, Schutz & Born 2004, sec.
6.2).

With the focal lengths f fixed at values of the covariance D, all other unknowns x have the covariance
Σ_held + S D Sᵀ, S = ∂x/∂f. The same follows from an adjustment with f free, in which P is their covariance, when
D⁻¹ − P⁻¹ is added to their normal equations: information is taken away where the image points pretend to more than they
know. So one factorisation serves every covariance, of points, poses and functions alike.
"""

from dataclasses import replace

import numpy as np

from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored, functions_of_border
from photogram.factors.graph import Problem
from photogram.projection import PARAMETERS


def with_considered(problem: Problem, state: State) -> Problem:
    """Return the problem whose covariances count the focal lengths that are considered; as it is where none is.

    It is for covariances at ``state``, the minimum of ``problem``, and not to be minimised. Raises IndeterminateError
    where the normal equations are singular.
    """
    cameras = problem.block.cameras
    sigma = np.array([camera.considered_focal_sigma_px for camera in cameras])
    chosen = np.flatnonzero(sigma > 0.0)
    if not len(chosen):
        return problem
    freed = tuple(
        replace(c, sigmas=np.concatenate([[s], c.sigmas[1:]])) if s > 0.0 else c
        for c, s in zip(cameras, sigma.tolist(), strict=True)
    )
    free = replace(problem, block=replace(problem.block, cameras=freed))
    reduced = factored(free, state)
    focal = PARAMETERS * chosen
    P = functions_of_border(reduced.layout).covariance(reduced)[np.ix_(focal, focal)]
    information = np.zeros((len(cameras), len(cameras)))
    information[np.ix_(chosen, chosen)] = np.diag(1.0 / sigma[chosen] ** 2) - np.linalg.inv(P)
    return replace(free, focal_information=information)


def without_considered(problem: Problem) -> Problem:
    """Return the problem of ``with_considered`` with the focal lengths fixed as they were adjusted: it tells what the
    result follows of an error in the image points, where the other tells what the covariances are."""
    if problem.focal_information is None:
        return problem
    fixed = tuple(
        replace(c, sigmas=np.concatenate([[0.0], c.sigmas[1:]])) if c.considered_focal_sigma_px > 0.0 else c
        for c in problem.block.cameras
    )
    return replace(problem, block=replace(problem.block, cameras=fixed), focal_information=None)
