"""The pages of the documentation, and the code that stands in them."""

from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
PAGES = tuple(
    path.relative_to(ROOT).as_posix()
    for path in (
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs" / "course").glob("*.md")),
        *(ROOT / name for name in ("README.md", "DESIGN.md", "CONTRIBUTING.md")),
        *sorted((ROOT / "examples").rglob("*.md")),
    )
)


@dataclass(frozen=True)
class CodeBlock:
    """A fenced block of a page: where it begins, what language it says, and its text."""

    page: str
    line: int
    language: str
    code: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def text_of(page: str) -> str:
    """Return a page by its path from the root."""
    return (ROOT / page).read_text(encoding="utf-8")


def blocks_in(text: str, page: str = "") -> list[CodeBlock]:
    """Return the fenced blocks of a text, in their order."""
    return [
        CodeBlock(page, token.map[0] + 1 if token.map else 0, token.info.strip(), token.content)
        for token in MarkdownIt().parse(text)
        if token.type == "fence"
    ]


def blocks(language: str, *pages: str) -> list[CodeBlock]:
    """Return the blocks of one language on some pages, or on all."""
    return [block for page in pages or PAGES for block in blocks_in(text_of(page), page) if block.language == language]
