"""The languages there are, by the codes that a project file names them with."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, get_args

LanguageCode = Literal["en", "de", "es", "pt", "fr"]

CODES: tuple[LanguageCode, ...] = get_args(LanguageCode)

LOCALES: Mapping[LanguageCode, str] = MappingProxyType(
    {"en": "en_GB", "de": "de", "es": "es", "pt": "pt_BR", "fr": "fr"}
)
"""What the CLDR calls them: their dates, decimal signs and lists."""
