"""Addresses of a page, each a call: what it returns is sent as JSON, what it raises as the sentence that says why.

What is ``Said`` there is sent in the language of the page, all else as it is.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from photogram.errors import PhotogramError
from photogram.languages.language import Language
from photogram.languages.said import in_language, said_of
from photogram.loopback.languages import asked_language
from photogram.wording import printable, shortened

Query = Mapping[str, str]
"""What stands behind the question mark of an address, and in place of its ``{names}``."""


class Asked(BaseModel):
    """What a page sends: no more than is known, each of the kind that it must be."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Nothing(Asked):
    """An empty object, where a call needs no more than its name."""


AskedT = TypeVar("AskedT")


async def answered(call: Callable[[], Any], language: Language) -> Response:
    """Call in a thread of its own, and return as answer what comes out, or 400 with what was wrong and the language
    that says it."""
    try:
        outcome = await run_in_threadpool(call)
    except (PhotogramError, ValueError) as error:
        said = said_of(error)
        text, tag = (str(error), "en") if said is None else (said.in_language(language), language.tag)
        return JSONResponse({"error": printable(text), "lang": tag}, 400)
    except OSError as error:
        return JSONResponse({"error": printable(f"{error.filename}: {error.strerror}"), "lang": "en"}, 400)
    if isinstance(outcome, Response):
        return outcome
    return JSONResponse({} if outcome is None else in_language(outcome, language))


def got(address: str, call: Callable[[Query], object]) -> Route:
    """Return the route of what is asked for."""

    async def answer(request: Request) -> Response:
        query = {**request.query_params, **request.path_params}
        return await answered(lambda: call(query), asked_language(request))

    return Route(address, answer, methods=["GET"])


def got_in_language(address: str, call: Callable[[Language], object]) -> Route:
    """Return the route of what is asked for in the language of the page."""

    async def answer(request: Request) -> Response:
        language = asked_language(request)
        return await answered(lambda: call(language), language)

    return Route(address, answer, methods=["GET"])


def posted(address: str, kind: type[AskedT] | TypeAdapter[AskedT], call: Callable[[AskedT], object]) -> Route:
    """Return the route of what is to be done, sent as JSON of a kind: a model, or an adapter of a union of them."""
    adapter = kind if isinstance(kind, TypeAdapter) else TypeAdapter(kind)

    async def answer(request: Request) -> Response:
        try:
            asked = adapter.validate_json(await request.body())
        except ValidationError as error:
            return JSONResponse({"error": printable(_in_words(error)), "lang": "en"}, 400)
        except TimeoutError:
            return JSONResponse({"error": "the request came too slowly", "lang": "en"}, 408)
        return await answered(lambda: call(asked), asked_language(request))

    return Route(address, answer, methods=["POST"])


def _in_words(error: ValidationError) -> str:
    first = error.errors()[0]
    where = ".".join(map(str, first["loc"])) or "the request"
    return f"{where}: {shortened(first['msg'])}"
