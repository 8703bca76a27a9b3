"""Names of columns as surveyors and programs write them, in English and in other languages of the field.

A name is compared without its unit, in small letters, without accents and with one underscore for whatever separates
its words: ``Sigma Height [m]`` is sigma_height, ``Höhe`` is hohe.
"""

import re
import unicodedata
from collections.abc import Iterable, Mapping

from photogram.files.tables.column_units import without_unit

Names = Mapping[str, tuple[str, ...]]
"""The names of each quantity; of several columns of one quantity the name that comes first counts."""

POINT = (
    "name", "point", "id", "label", "point_id", "pointid", "point_name", "pointname", "point_number", "point_no",
    "pointno", "point_nr", "pt", "pt_id", "ptid", "pt_no", "pnt", "pno", "number", "no", "nr", "gcp", "gcp_label",
    "gcp_name", "gcp_id", "gcpname", "target", "target_name", "target_id", "marker", "marker_label", "control_point",
    "station", "punkt", "punktnummer", "punkt_nr", "punktnr", "punktname", "punkt_id", "pkt", "pktnr", "pkt_nr", "nom",
    "nom_du_point", "point_matricule", "matricule", "numero", "nombre", "nombre_del_punto", "punto", "id_punto", "nome",
    "nome_punto", "ponto", "punt", "puntnummer", "numer", "点名", "点号", "名称", "имя",
)  # fmt: skip

PHOTOGRAPH = (
    "photograph", "photo", "photo_name", "photoname", "image", "image_name", "imagename", "image_filename", "img",
    "img_name", "picture", "file", "filename", "file_name", "sourcefile", "source_file", "bild", "bildname", "foto",
    "imagen", "immagine", "imagem",
)  # fmt: skip

_LONGITUDE = (
    "longitude", "lon", "long", "lng", "gpslongitude", "gps_longitude", "x_longitude", "longitude_x", "lon_x",
    "wgs84_longitude", "geogr_lange", "geographische_lange", "lange", "laenge", "longitud", "longitudine", "经度",
    "долгота",
)  # fmt: skip
_LATITUDE = (
    "latitude", "lat", "gpslatitude", "gps_latitude", "y_latitude", "latitude_y", "lat_y", "wgs84_latitude",
    "geogr_breite", "geographische_breite", "breite", "latitud", "latitudine", "纬度", "широта",
)  # fmt: skip
_EASTING = (
    "easting", "east", "e", "x_easting", "x_east", "easting_x", "east_x", "lon_easting", "grid_easting", "grid_east",
    "utm_easting", "utm_e", "utm_east", "local_easting", "rechtswert", "rechts", "rw", "ostwert", "ost", "x_rechtswert",
    "y_rechtswert", "este", "coordenada_este", "x_este", "est", "leste", "oost", "东坐标", "восток",
)  # fmt: skip
_NORTHING = (
    "northing", "north", "n", "y_northing", "y_north", "northing_y", "north_y", "lat_northing", "grid_northing",
    "grid_north", "utm_northing", "utm_n", "utm_north", "local_northing", "hochwert", "hoch", "hw", "nordwert", "nord",
    "y_hochwert", "x_hochwert", "norte", "coordenada_norte", "y_norte", "noord", "北坐标", "север",
)  # fmt: skip
_X = ("x", "geo_x", "x_coordinate", "coord_x", "x_coord", "koordinate_x")
_Y = ("y", "geo_y", "y_coordinate", "coord_y", "y_coord", "koordinate_y")
_ELLIPSOIDAL_HEIGHT = (
    "ellipsoidal_height", "height_ellipsoidal", "ellipsoid_height", "ellipsoidal_elevation", "ellipsoid_elevation",
    "height_ell", "h_ell", "ellh", "hell", "ell_height", "ellip_height", "ellipsoidische_hohe", "ellipsoidische_hoehe",
    "ell_hohe", "hauteur_ellipsoidale", "altura_elipsoidal", "wgs84_height", "final_ellipsoidal", "ellipsoidal",
    "大地高", "椭球高",
)  # fmt: skip
_HEIGHT = (
    "height", "h", "altitude", "alt", "elevation", "elev", "z", "z_altitude", "z_height", "z_elevation", "altitude_z",
    "elevation_z", "geo_z", "gpsaltitude", "gps_altitude", "gps_height", "up", "rl", "reduced_level", "level",
    "orthometric_height", "ortho_height", "height_orthometric", "orthometric_elevation", "elevation_msl", "height_msl",
    "msl", "gelandehohe", "hohe", "hoehe", "hohe_nhn", "hoehe_nhn", "nhn", "meereshohe", "hauteur", "altura", "cota",
    "quota", "altitud", "elevacion", "hoogte", "wysokosc", "高程", "высота",
)  # fmt: skip

_SIGMA: Names = {
    "sigma": ("sigma", "accuracy", "accuracy_x_y_z", "accuracy_xyz", "rms", "std", "stddev",
              "standard_deviation", "3d_rms"),
    "sigma_plan": (
        "sigma_plan", "sigma_xy", "accuracy_horz", "accuracy_horizontal", "horizontal_accuracy", "horz_accuracy",
        "accuracy_xy", "accuracy_x_y", "xy_accuracy", "x_y_accuracy", "h_accuracy", "acc_xy", "std_xy", "hacc", "h_acc",
        "acc_h", "sigmahoriz", "sigma_horiz", "sigma_horizontal", "lateral_rms", "hrms", "h_rms", "hz_rms", "hz_prec",
        "horizontal_rms", "horizontal_precision", "h_precision", "horz_precision", "hsdv", "stdh", "lagegenauigkeit",
        "precision_horizontale", "precision_horizontal",
    ),
    "sigma_east": (
        "sigma_east", "sigma_easting", "sigma_e", "sigma_x", "sigma_lon", "sigma_longitude", "sde", "sd_e", "sd_east",
        "sdeast", "sdlon", "std_e", "std_east", "std_x", "std_lon", "stdlon", "rtkstdlon", "x_acc", "x_accuracy",
        "x_std", "xstd", "easting_rms", "rms_easting", "east_rms", "x_rms", "accuracy_x", "longitude_rms", "stddev_e",
        "stdev_e", "stddev_east", "easting_accuracy", "sd_x", "s_e", "mx",
    ),
    "sigma_north": (
        "sigma_north", "sigma_northing", "sigma_n", "sigma_y", "sigma_lat", "sigma_latitude", "sdn", "sd_n", "sd_north",
        "sdnorth", "sdlat", "std_n", "std_north", "std_y", "std_lat", "stdlat", "rtkstdlat", "y_acc", "y_accuracy",
        "y_std", "ystd", "northing_rms", "rms_northing", "north_rms", "y_rms", "accuracy_y", "latitude_rms", "stddev_n",
        "stdev_n", "stddev_north", "northing_accuracy", "sd_y", "s_n", "my",
    ),
    "sigma_height": (
        "sigma_height", "sigma_h", "sigma_z", "sigma_u", "sigma_up", "sigma_alt", "sigma_elevation", "sdu", "sd_u",
        "sd_up", "sdheight", "sd_height", "sdhgt", "std_u", "std_up", "std_z", "std_h", "std_height", "std_hgt",
        "stdhgt", "rtkstdhgt", "z_acc", "z_accuracy", "z_std", "zstd", "elevation_rms", "rms_elevation", "height_rms",
        "ellipsoidal_height_rms", "z_rms", "accuracy_z", "accuracy_vert", "accuracy_vertical", "vertical_accuracy",
        "vert_accuracy", "v_accuracy", "vacc", "v_acc", "acc_v", "sigmavert", "sigma_vert", "sigma_vertical",
        "stddev_u", "stdev_u", "stddev_up", "vrms", "v_rms", "vt_rms", "vt_prec", "vertical_rms", "vertical_precision",
        "v_precision", "vert_precision", "vsdv", "stdv", "elevation_accuracy", "height_accuracy", "sd_z", "s_h", "mz",
        "hohengenauigkeit", "precision_verticale", "precision_vertical",
    ),
}  # fmt: skip

_PLACE: Names = {
    "longitude": _LONGITUDE, "latitude": _LATITUDE, "easting": _EASTING, "northing": _NORTHING, "x": _X, "y": _Y,
    "ellipsoidal_height": _ELLIPSOIDAL_HEIGHT, "height": _HEIGHT, **_SIGMA,
    "solution": (
        "solution", "solution_status", "solution_type", "q", "quality", "quality_flag", "fix", "fix_type", "fixtype",
        "fix_status", "status", "ambiguity_status", "gnss_status", "rtk_flag", "rtkflag", "flag", "corr_fix",
        "losungsstatus", "loesungsstatus",
    ),
}  # fmt: skip

POINTS: Names = {
    "name": POINT,
    **_PLACE,
    "cs_name": ("cs_name", "crs", "coordinate_system", "koordinatensystem"),
    "role": ("role",),
    "role_plan": ("role_plan",),
    "role_height": ("role_height",),
}
"""Of tables of ground points."""

POSITIONS: Names = {
    "photograph": (*PHOTOGRAPH, "name", "label"),
    **_PLACE,
    "yaw": ("yaw", "heading", "flight_yaw", "flightyawdegree"),
    "pitch": ("pitch", "flight_pitch", "flightpitchdegree"),
    "roll": ("roll", "flight_roll", "flightrolldegree"),
    "time": ("gps_time", "gpst", "gpstime", "gps_date_time", "time_gps"),
}
"""Of tables of camera positions."""

MARKS: Names = {
    "name": POINT,
    "photograph": PHOTOGRAPH,
    "u": ("u", "x", "px", "column", "im_x", "image_x", "pixel_x", "x_pixel", "pixel_column"),
    "v": ("v", "y", "py", "row", "im_y", "image_y", "pixel_y", "y_pixel", "pixel_row"),
    "sigma": ("sigma",),
    "sigma_u": ("sigma_u",),
    "sigma_v": ("sigma_v",),
    "rho": ("rho",),
    "kind": ("kind",),
    "raw_u": ("raw_u",),
    "raw_v": ("raw_v",),
    "doubtful": ("doubtful",),
}
"""Of tables of marks."""

WORDS = frozenset(
    ("name", "photograph", "solution", "cs_name", "role", "role_plan", "role_height", "kind", "use", "time", "doubtful")
)
"""Quantities that are no figures."""

_PASSED_OVER = frozenset((
    "code", "code_description", "comment", "comments", "date", "description", "desc", "descr", "feature",
    "feature_code", "note", "notes", "remark", "remarks", "time", "origin", "tilt_angle", "antenna_height",
    "antenna_height_units", "antenna_offset", "correction_type", "averaging_start", "averaging_end", "samples",
    "pdop", "gdop", "hdop", "vdop", "base_easting", "base_northing", "base_elevation", "base_longitude",
    "base_latitude", "base_ellipsoidal_height", "baseline", "mount_point", "mountpoint", "device_type",
    "device_serial_number", "lateral_rms", "enable", "enabled", "detected", "projections", "error", "total_error",
    "class", "layer", "type", "punktcode", "bemerkung", "kommentar", "beschreibung", "datum", "descripcion",
    "codigo", "descrizione", "codice", "descricao", "observaciones", "utc", "local_time", "age", "satellites",
    "gps_satellites", "glonass_satellites", "sats", "uid", "fid",
))  # fmt: skip
_RESULT = re.compile(r".+_(err|error|est|estimated|var|residual)$|(error|residual|estimated)_.+|d[xyz]|sd(ne|eu|un)")
"""Names of what another program has computed from its measurements, and of their covariances."""


_ELLIPSOIDAL = re.compile(r"[(\[]\s*(?:above )?(?:the )?ell", re.IGNORECASE)
"""Height (ellipsoidal): what it is above stands where others have a unit."""


def plain(column: str) -> str:
    """Return the name of a column in one spelling, without its unit."""
    text = without_unit(column.strip().lstrip("#%").strip()).lower().replace("ß", "ss")
    bare = "".join(c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
    return re.sub(r"[\s./:-]+|_+", "_", bare).strip("_")


def quantity_of(column: str, known: Names) -> str | None:
    """Return the quantity that a column's name says, None where it is none of the ``known``."""
    name = "" if column.startswith("#") else plain(column)
    quantity = next((quantity for quantity, names in known.items() if name in names), None)
    is_ellipsoidal = quantity == "height" and _ELLIPSOIDAL.search(column) is not None
    return "ellipsoidal_height" if is_ellipsoidal and "ellipsoidal_height" in known else quantity


def says_nothing(column: str) -> bool:
    """Return whether a column's name is one of those that are known to say nothing here."""
    name = plain(column)
    return not name or column.strip().startswith("#") or name in _PASSED_OVER or _RESULT.fullmatch(name) is not None


def all_names(known: Names) -> Iterable[str]:
    """Return every name of every quantity."""
    return (name for names in known.values() for name in names)
