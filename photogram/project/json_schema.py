"""The JSON Schema of project.yaml, by which editors complete it and check it."""

from typing import Annotated

from pydantic import TypeAdapter, create_model

from photogram.project.document import settings_model
from photogram.project.project import SECTIONS
from photogram.project.schema import ProjectFile
from photogram.settings.json_schema import schema_of


def project_schema() -> dict[str, object]:
    """Return the JSON Schema (draft 2020-12) of project.yaml: its keys, what they mean, their types, ranges and
    defaults.

    What keys mean together, such as the name of a camera that must stand under ``cameras``, is not in it.
    """
    sections = {
        name: (Annotated[settings_model(kind), " ".join(str(kind.__doc__).split())], None)
        for name, kind in SECTIONS.items()
    }
    whole = create_model("ProjectFile", __base__=ProjectFile, __doc__=ProjectFile.__doc__, **sections)  # type: ignore[call-overload]
    return schema_of(TypeAdapter(whole))
