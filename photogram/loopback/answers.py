"""Addresses of a page, each a call: what it returns is sent as JSON, what it raises as the sentence that says why."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from photogram.errors import PhotogramError
from photogram.wording import printable, shortened

Query = Mapping[str, str]
"""What stands behind the question mark of an address, and in place of its ``{names}``."""


class Asked(BaseModel):
    """What a page sends: no more than is known, each of the kind that it must be."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class Nothing(Asked):
    """An empty object, where a call needs no more than its name."""


AskedT = TypeVar("AskedT")


async def answered(call: Callable[[], Any]) -> Response:
    """Call in a thread of its own, and return as answer what comes out, or 400 with what was wrong."""
    try:
        outcome = await run_in_threadpool(call)
    except (PhotogramError, ValueError) as error:
        return JSONResponse({"error": printable(str(error))}, 400)
    except OSError as error:
        return JSONResponse({"error": printable(f"{error.filename}: {error.strerror}")}, 400)
    return outcome if isinstance(outcome, Response) else JSONResponse({} if outcome is None else outcome)


def got(address: str, call: Callable[[Query], object]) -> Route:
    """Return the route of what is asked for."""

    async def answer(request: Request) -> Response:
        query = {**request.query_params, **request.path_params}
        return await answered(lambda: call(query))

    return Route(address, answer, methods=["GET"])


def posted(address: str, kind: type[AskedT] | TypeAdapter[AskedT], call: Callable[[AskedT], object]) -> Route:
    """Return the route of what is to be done, sent as JSON of a kind: a model, or an adapter of a union of them."""
    adapter = kind if isinstance(kind, TypeAdapter) else TypeAdapter(kind)

    async def answer(request: Request) -> Response:
        try:
            asked = adapter.validate_json(await request.body())
        except ValidationError as error:
            return JSONResponse({"error": printable(_in_words(error))}, 400)
        except TimeoutError:
            return JSONResponse({"error": "the request came too slowly"}, 408)
        return await answered(lambda: call(asked))

    return Route(address, answer, methods=["POST"])


def _in_words(error: ValidationError) -> str:
    first = error.errors()[0]
    where = ".".join(map(str, first["loc"])) or "the request"
    return f"{where}: {shortened(first['msg'])}"
