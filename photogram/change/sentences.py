"""What is to be known of a comparison of two surfaces beside its figures, in sentences."""

from photogram.change.files.change_files import SurfaceChange
from photogram.files.maps.rasters import HIGHEST_M, LOWEST_M
from photogram.volumes.stable_ground import Registration


def sentences_of(change: SurfaceChange, remedy: str = "--coregister does") -> list[str]:
    """Return what was assumed, converted or taken off of two surfaces; ``remedy`` is how an offset on stable ground
    would be taken off."""
    said = list(change.remarks)
    if change.bases:
        said.append("The base of each polygon is the plane through the ground around it.")
    if change.resampled:
        said.append(f"Interpolated on cells of {change.cell_m:g} m: {', '.join(change.resampled)}.")
    said += [
        f"Heights of {name}: no height system is stated; they are taken to count from that of the other surface."
        for name in change.undeclared_heights
    ]
    said += [
        f"Zeros of {name} lie at its rim, far from all other heights: they are taken for no data."
        for name in change.zeros_without_data
    ]
    low, high = f"{LOWEST_M:.0f}".replace("-", "−"), f"{HIGHEST_M:.0f}"
    said += [
        f"{name} declares no value for no data: heights below {low} m and above {high} m are taken for it."
        for name in change.impossible_heights
    ]
    if change.interpolated_cells:
        said.append(
            f"{change.interpolated_cells} cells are filled or without a sigma: they have no level of detection."
        )
    if change.registration is not None:
        said.append(registration_words(change.registration, change.registration_applied, remedy))
    return said


def volume_sentences(change: SurfaceChange) -> list[str]:
    """Return what the volumes of a comparison leave out."""
    said = ["Polygons overlap: no sum of them is given."] if change.total is None else []
    missing = [v.name for v in change.volumes if v.unmeasured_m2 > 0.0]
    if missing:
        said.append(f"Not measured in both everywhere, and no volume is counted there: {', '.join(missing)}.")
    filled = [f"{v.name} ({v.interpolated_m3:+.2f} m³)" for v in change.volumes if v.interpolated_m2 > 0.0]
    if filled:
        said.append(f"Partly from filled cells, which no sigma covers: {', '.join(filled)}.")
    return said


def registration_words(registration: Registration, applied: bool, remedy: str = "--coregister does") -> str:
    """Return what stable ground says of two epochs, in a sentence; ``remedy`` is how it would be taken off."""
    values = ", ".join(
        f"{name} {value:+.6f} ± {sigma:.6f}" if "tilt" in name or "rotation" in name else
        f"{name.removesuffix('_m')} {value:+.4f} ± {sigma:.4f} m"
        for name, value, sigma in zip(registration.names, registration.value, registration.sigma, strict=True)
    ).replace("_", " ")  # fmt: skip
    stated = registration.expected_sigma[0]
    expected = "" if not stated > 0.0 else f"; both epochs state ± {stated:.4f} m for the offset"
    remaining_m = registration.remaining_m
    rest = f", ± {remaining_m:.4f} m between its parts beyond noise" if remaining_m > 0.0 else ""
    done = "taken off" if applied else f"not taken off ({remedy})"
    return (
        f"Stable ground: {values}{expected}; {done}. Residuals: RMS {registration.after_rms_m:.4f} m over "
        f"{registration.cells}{rest}; {registration.rejected} contradict the rest."
    )
