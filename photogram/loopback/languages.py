"""In which language a page is answered: the one that was chosen on it, else the first that its browser accepts."""

from importlib.resources import files
from pathlib import Path

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route

from photogram.languages.codes import CODES
from photogram.languages.language import Language
from photogram.languages.pages import page_words, preferred

COOKIE = "photogram_language"
"""What a page writes where a language is chosen: cookies are kept for this machine, whatever the port."""


def asked_language(request: Request) -> Language:
    """Return the language in which a request is to be answered."""
    chosen = request.cookies.get(COOKIE)
    known = next((code for code in CODES if code == chosen), None)
    return preferred(request.headers.get("accept-language", "")) if known is None else Language(known)


def words(page: Path) -> list[Route]:
    """Return the routes, below that of a page whose files lie in a folder, of what it says in the language that is
    asked for, and of the module that says it."""

    def answer(request: Request) -> Response:
        return JSONResponse(page_words(page, asked_language(request)))

    module = files("photogram.loopback").joinpath("words.js")
    return [
        Route("/words.json", answer, methods=["GET"]),
        Route("/static/words.js", lambda _: FileResponse(str(module), media_type="text/javascript"), methods=["GET"]),
    ]
