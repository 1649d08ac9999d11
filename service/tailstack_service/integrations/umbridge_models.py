"""The models of UM-Bridge, as a computing process evaluates them.

``score``: numbers of a design in, numbers of its score out, with the exact derivative of P95.  ``chain``: one shot,
from its random numbers to the error at the tool, through the whole chain without linearisation.  The ``config`` of a
call says which design; without one it is the example ``demo``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.special import ndtri

from tailstack import compile_design
from tailstack.arrays import Array
from tailstack.design.pointers import find_numbers, find_places, pointer_of, suggest, value_at
from tailstack.errors import Problem, TailstackError
from tailstack.extras import name_missing_extra
from tailstack.json_text import write_json

from ..documents import to_json
from ..examples import list_example_designs, read_example
from ..operations.content import canonical, loaded_design
from ..operations.effort import score_seconds, size_of
from ..operations.options import Options
from ..operations.patches import NAMED, PATCH
from ..operations.registry import OPERATIONS
from ..operations.request import RawRequest, Request, parse_json, read_options, read_request
from ..problems import RefusedAt, RequestError
from ..settings import Settings
from ..task import Estimated

NOT_FOUND, UNSUPPORTED, INVALID = "ModelNotFound", "UnsupportedFeature", "InvalidInput"  # the protocol's own words
MODELS = ("score", "chain")
VERBS = {  # how many times the time of a score
    "ModelInfo": 0, "InputSizes": 0.5, "OutputSizes": 0.5, "Evaluate": 1, "Gradient": 15, "ApplyJacobian": 15,
    "ApplyHessian": 0,
}  # fmt: skip
DERIVATIVES = ("Gradient", "ApplyJacobian")
MOST_NUMBERS = 1_000  # inputs, or outputs, of one call
EXAMPLE = "demo"
SEQUENCES = (
    "the first point of a Sobol sequence is 0: scramble the sequence, or shift every point by half of 1 / N; leaving "
    "out the point alone unbalances the others"
)
P95_OUTPUTS = ("p95_mm", "localisation/p95_mm")  # of a target: what has a derivative


@dataclass(frozen=True, slots=True)
class Reply:
    """What a call came to."""

    status: int
    body: bytes


class ModelError(RequestError):
    """A refusal for which the protocol has a word of its own."""

    def __init__(self, word: str, problem: Problem) -> None:
        super().__init__(problem)
        self.word = word


Numbers = Annotated[list[float], Field(max_length=MOST_NUMBERS)]


class ModelCall(Options):
    """The body of a call."""

    name: str = Field(description="The model.")
    config: dict[str, Any] = Field(default_factory=dict, description="Which design, and which numbers of it.")
    input: list[Numbers] | None = None
    outWrt: int = Field(0, ge=0)
    inWrt: int = Field(0, ge=0)
    inWrt1: int = Field(0, ge=0)
    inWrt2: int = Field(0, ge=0)
    sens: Numbers | None = None
    vec: Numbers | None = None


class DesignConfig(Options):
    """Which design a call means."""

    design: dict[str, Any] | None = None
    design_sha256: str | None = None
    patch: dict[str, Any] | None = None
    example: str | None = None


Paths = Annotated[list[str], Field(min_length=1, max_length=MOST_NUMBERS)]


class ScoreConfig(DesignConfig):
    """The numbers of a design that are varied, and those of its score that are answered."""

    inputs: Paths | None = None
    outputs: Paths = Field(default_factory=lambda: ["targets.0.p95_mm"])


class ChainConfig(DesignConfig):
    """The target whose error is answered."""

    target: str | None = None
    error: Literal["tcp", "localisation"] = "tcp"


def error_reply(word: str, error: TailstackError, prefix: str = "") -> Reply:
    """A refusal as the protocol says it; every problem in one line each."""
    lines = [
        f"{prefix}{problem.pointer}: {problem.detail}" + (f"; {problem.hint}" if problem.hint else "")
        for problem in error.problems
    ]
    message = "\n".join(line.removeprefix(": ") for line in lines)
    return Reply(400, canonical({"error": {"type": word, "message": message}}))


def answer(verb: str, body: bytes, base: bytes | None, settings: Settings) -> Reply | Estimated:
    """The reply to one call, when it was read."""
    return _reply(partial(_read, verb, body, base, settings))


def _reply(make: Callable[[], Any]) -> Reply | Estimated:
    try:
        with name_missing_extra():
            result = make()
            if isinstance(result, Estimated):
                return Estimated(result.seconds, partial(_reply, result.compute))
            return Reply(200, canonical(result))
    except ModelError as error:
        return error_reply(error.word, error)
    except RefusedAt as refused:
        return error_reply(INVALID, refused, "/config")
    except TailstackError as error:
        return error_reply(INVALID, error)


def _read(verb: str, body: bytes, base: bytes | None, settings: Settings) -> dict[str, Any] | Estimated:
    """The answer where it needs no design, and otherwise how long it will take."""
    data = parse_json(body, settings, yaml=False)
    name = data.get("name")
    if name not in MODELS:
        detail = f"no model is called {str(name)[:60]!r}; there are {', '.join(MODELS)}"
        raise ModelError(NOT_FOUND, Problem("/name", "unknown-value", detail))
    if verb == "ModelInfo":
        derived = name == "score"
        return {"support": {
            "Evaluate": True, "Gradient": derived, "ApplyJacobian": derived, "ApplyHessian": False,
        }}  # fmt: skip
    if verb == "ApplyHessian" or (verb in DERIVATIVES and name != "score"):
        detail = f"the model {name} has no {verb}"
        raise ModelError(UNSUPPORTED, Problem("/name", "unsupported", detail, "ask ModelInfo for what it supports"))
    call = read_options(ModelCall, data, ())
    options: DesignConfig = _read_config(ScoreConfig if name == "score" else ChainConfig, call.config)
    request = _read_design(options, base, settings)
    seconds = score_seconds(map(size_of, request.designs), losses=_asks_for_losses(getattr(options, "outputs", ())))
    return Estimated(VERBS[verb] * seconds, partial(_answer, verb, call, options, request))


def _asks_for_losses(paths: Sequence[str]) -> bool:
    """Whether the losses of fiducials are among the outputs: they can take longer than the rest of a score."""
    return any("losses" in path for path in paths)


def _answer(verb: str, call: ModelCall, options: Any, request: Request) -> dict[str, Any]:
    model = (_score_model if isinstance(options, ScoreConfig) else _chain_model)(options, request.data["design"])
    if verb == "InputSizes":
        return {"inputSizes": [model.inputs]}
    if verb == "OutputSizes":
        return {"outputSizes": [model.outputs]}
    values = _single_vector(call.input, model.inputs)
    if verb == "Evaluate":
        return {"output": [model.evaluate(values).tolist()]}
    for field, index in (("outWrt", call.outWrt), ("inWrt", call.inWrt)):
        if index:
            detail = f"there is one vector of inputs and one of outputs, number 0; got {index}"
            raise RequestError(Problem(f"/{field}", "out-of-range", detail))
    if verb == "Gradient":
        sens = _vector(call.sens, model.outputs, "/sens")
        return {"output": (sens @ model.jacobian(values, sens != 0)).tolist()}
    vec = _vector(call.vec, model.inputs, "/vec")
    return {"output": (model.jacobian(values, np.ones(model.outputs, dtype=bool)) @ vec).tolist()}


def _single_vector(given: list[list[float]] | None, size: int) -> Array:
    if given is None or len(given) != 1:
        many = "none" if given is None else len(given)
        raise RequestError(Problem("/input", "wrong-length", f"input is a list of one vector of {size}; got {many}"))
    return _vector(given[0], size, "/input/0")


def _vector(given: list[float] | None, size: int, pointer: str) -> Array:
    if given is None or len(given) != size:
        many = "none" if given is None else len(given)
        raise RequestError(Problem(pointer, "wrong-length", f"a vector of {size} numbers is needed; got {many}"))
    return np.array(given, dtype=float)


@dataclass(frozen=True, slots=True)
class VectorModel:
    """One vector in, one vector out."""

    inputs: int
    outputs: int
    evaluate: Callable[[Array], Array]
    jacobian: Callable[[Array, Array], Array]  # (outputs, inputs); of the outputs that are wanted, the others 0


# --- which design -----------------------------------------------------------------------------------------


def _read_config(kind: type[Any], config: dict[str, Any]) -> Any:
    try:
        return read_options(kind, config, ())
    except RequestError as error:
        raise RefusedAt.place(error) from None


def _read_design(config: DesignConfig, base: bytes | None, settings: Settings) -> Request:
    """The design that a configuration means, checked.  Raises DesignReferenceUnresolved, RefusedAt."""
    given = {name: getattr(config, name) for name in ("design", NAMED, PATCH) if getattr(config, name) is not None}
    example = config.example
    if "design" not in given and NAMED not in given:
        example = EXAMPLE if example is None else example
        if example not in list_example_designs():
            known = ", ".join(list_example_designs())
            detail = f"no example is called {example[:60]!r}; there are {known}"
            raise RefusedAt.place(RequestError(Problem("/example", "unknown-value", detail)))
        given["design"] = read_example(example)
    elif example is not None:
        detail = f"give one of design, {NAMED} and example"
        raise RefusedAt.place(RequestError(Problem("/example", "one-of", detail)))
    try:
        return read_request(RawRequest("json", write_json(given).encode(), (), base), OPERATIONS["score"], settings)
    except RequestError as error:
        raise RefusedAt.place(error) from None


# --- score ------------------------------------------------------------------------------------------------


def _score_model(options: ScoreConfig, data: dict[str, Any]) -> VectorModel:
    inputs = _half_widths_of(data) if options.inputs is None else options.inputs
    try:
        function = _design_function(canonical(data), tuple(inputs))
    except TailstackError as error:
        raise RefusedAt.place(error, "/design") from None
    paths = options.outputs
    losses = _asks_for_losses(paths)

    def score_at(values: Array) -> Any:
        return json.loads(to_json(function.score(values, losses=losses)))

    def evaluate(values: Array) -> Array:
        record = score_at(values)
        return np.array([_number_of(record, path, k)[1] for k, path in enumerate(paths)])

    def jacobian(values: Array, wanted: Array) -> Array:
        record = score_at(values)
        gradients = np.zeros((len(paths), len(function.pointers)))
        for k in np.flatnonzero(wanted):
            pointer, _ = _number_of(record, paths[k], int(k))
            target, error = _differentiable(record, pointer, int(k))
            gradients[k] = function.p95_gradient(values, target, error)[1]
        return gradients

    return VectorModel(len(function.pointers), len(paths), evaluate, jacobian)


@lru_cache(maxsize=8)
def _design_function(content: bytes, inputs: tuple[str, ...]) -> Any:
    """The function of a design, kept with what it has found out about its inputs."""
    from tailstack import DesignFunction

    return DesignFunction(loaded_design(content), inputs)


def _half_widths_of(data: Mapping[str, Any]) -> list[str]:
    """The half-widths in the seats of a design, in its order: what is varied where nothing else is said."""
    places = [place for place in find_numbers(data, ()) if place[0] == "interfaces"]
    return [
        "".join(f"/{step}" for step in place) for place in places if place[-1] in ("half_width_deg", "half_width_mm")
    ]


def _number_of(record: Any, path: str, k: int) -> tuple[str, float]:
    """Pointer and value of a number of a score."""
    pointer = pointer_of(record, path)
    places = find_places(record, pointer)
    value = value_at(record, places[0]) if len(places) == 1 else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        detail = f"an output is one number of the score; {path[:80]} is none"
        hint = suggest(record, pointer) or "GET /v1/schemas/score lists its fields"
        raise RefusedAt.place(RequestError(Problem(f"/outputs/{k}", "not-found", detail, hint)))
    return pointer, float(value)


def _differentiable(record: Any, pointer: str, k: int) -> tuple[str, Any]:
    """Target and error whose P95 an output is."""
    _, _, rest = pointer.partition("/targets/")
    number, _, field = rest.partition("/")
    if field not in P95_OUTPUTS:
        detail = f"only P95 has a derivative here; {pointer} is something else"
        hint = "give it the sensitivity 0, or take differences of Evaluate"
        raise RefusedAt.place(RequestError(Problem(f"/outputs/{k}", "no-derivative", detail, hint)))
    return record["targets"][int(number)]["name"], "tcp" if field == "p95_mm" else "localisation"


# --- chain ------------------------------------------------------------------------------------------------


def _chain_model(options: ChainConfig, data: dict[str, Any]) -> VectorModel:
    content = canonical(data)
    try:
        plan, index = _chain_plan(content, options.target, options.error)
    except TailstackError as error:
        raise RefusedAt.place(error, "/design") from None

    def evaluate(values: Array) -> Array:
        from tailstack.montecarlo import evaluate as run

        errors = run(plan, _deviates(plan, values)[None])
        return np.asarray(errors[0, index, 0 if options.error == "tcp" else 1])

    return VectorModel(plan.dimension, 3, evaluate, lambda values, wanted: np.zeros((0, 0)))


@lru_cache(maxsize=8)
def _chain_plan(content: bytes, target: str | None, error: str) -> tuple[Any, int]:
    """The chain of a design with bounded components at the worst vertex for P95, and the number of the target."""
    from tailstack.contributors import worst_case
    from tailstack.montecarlo import compile_plan
    from tailstack.propagation.linear import linearise

    system = compile_design(loaded_design(content))
    names = [entry.name for entry in system.targets]
    if target is not None and target not in names:
        detail = f"no target is called {target[:60]!r}; there are {', '.join(names[:20])}"
        raise RequestError(Problem("/targets", "unknown-value", detail))
    index = 0 if target is None else names.index(target)
    model = linearise(system, system.targets[index])
    return compile_plan(system, vertex=worst_case(model, error, 0.95).vertex(model)), index


def _deviates(plan: Any, values: Array) -> Array:
    """Standardised deviates from numbers that are uniform between 0 and 1, by the inverse of each distribution."""
    if not ((values > 0) & (values < 1)).all():
        at = int(np.flatnonzero(~((values > 0) & (values < 1)))[0])
        detail = f"a random number is between 0 and 1, and neither; got {values[at]:g}"
        raise RequestError(Problem(f"/input/0/{at}", "out-of-range", detail, SEQUENCES * (values[at] in (0, 1))))
    laws = np.array([law.value for law in plan.laws])
    folded = np.sqrt(2 * np.minimum(values, 1 - values)) - 1
    triangular = np.where(values < 0.5, folded, -folded)
    return np.where(laws == "normal", ndtri(values), np.where(laws == "uniform", 2 * values - 1, triangular))
