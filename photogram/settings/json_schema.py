"""JSON Schemas, made of types as pydantic reads them."""

from typing import Any

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema

DIALECT = "https://json-schema.org/draft/2020-12/schema"


class _Plain(GenerateJsonSchema):
    """Titles of keys would only repeat them."""

    def field_title_should_be_set(self, schema: CoreSchema) -> bool:  # noqa: ARG002
        return False

    def encode_default(self, dft: object) -> object:
        """Return a default; that of a block is that of its keys."""
        return None if isinstance(dft, BaseModel) else super().encode_default(dft)


def schema_of(types: TypeAdapter[Any]) -> dict[str, object]:
    """Return the JSON Schema (draft 2020-12) of documents of such types."""
    return {"$schema": DIALECT, **types.json_schema(schema_generator=_Plain)}
