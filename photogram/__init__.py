"""Bundle-adjustment photogrammetry: photographs and ground control to a surface model that says how good it is.

    import photogram as pg

    pg.init("photographs/", control="gcp_list.txt")      # writes project.yaml
    pg.check_project("project.yaml")                     # what is wrong with it, before the work
    survey = pg.open_survey("project.yaml").update(until="adjustment", progress=print)
    survey.adjustment()                                  # estimates, residuals, covariances

Names are resolved when they are first used, so that importing photogram imports nothing that computes. Arrays carry
unit and frame in their names: ``_px`` pixels (the centre of the top-left pixel is (0, 0)), ``_world_m`` the local
east-north-up frame of a survey, ``_map_m`` the map grid of the project. What a user can mend is raised as a
PhotogramError whose message says what to do.
"""

import warnings

import lazy_loader

__version__ = "0.3.0"

_resolved, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]

_FORMER_NAMES = {
    "check": "check_project",
    "compare": "compare_to_reference",
    "open": "open_survey",
    "predict": "predict_accuracy",
    "snoop": "adjust_with_snooping",
    "view": "write_view",
}
"""Names of version 0.2, which go with version 0.4, and what they are called now."""


def __getattr__(name: str) -> object:
    if name in _FORMER_NAMES:
        present = _FORMER_NAMES[name]
        warnings.warn(f"photogram.{name} is called photogram.{present} now", DeprecationWarning, stacklevel=2)
        name = present
    resolved: object = _resolved(name)
    return resolved
