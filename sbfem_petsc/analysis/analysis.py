"""What every analysis does before it begins: its arguments are compared over the ranks and its options
checked, once, so that the function itself goes from input to problem to result.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

from ..checks import flag, path
from ..checks import progress as check_progress
from ..errors import ANALYSIS, called
from ..options import Options
from ..ranks.parallel import agreed, collective, ranks_of
from ..reduction.reduced_model import ReducedModel
from ..system.elements.plausibility import warn_if_large
from ..system.model import Model

Result = TypeVar("Result")
Parameters = ParamSpec("Parameters")


def analysis(
    options: type[Options], *, rubs: bool = False
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Decorator of a public analysis that all ranks call together.

    The function is given its options as their class has checked them, `file`, `resume` and `progress` are
    checked too; a model whose faces rub is refused unless the function `rubs`. An error of one rank is raised
    on all of those that share the model. Displacements that are not small are told of when its result is
    there, but not within another analysis. Its signature and docstring are written out for readers and tools;
    a test compares them with the class.
    """

    def decorated(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        signature, owner = inspect.signature(function), function.__name__

        @functools.wraps(function)
        def call(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            bound = None
            with contextlib.suppress(TypeError):
                bound = signature.bind(*args, **kwargs)
            if bound is None:  # Python says it in a sentence of its own
                return function(*args, **kwargs)
            bound.apply_defaults()
            given = bound.arguments
            ranks = ranks_of(list(given.values()))
            with contextlib.nullcontext() if ranks is None else collective(ranks):
                asked = options.checked(owner, {name: given[name] for name in options.model_fields})
                _check_recording(owner, given)
            given.update((name, getattr(asked, name)) for name in options.model_fields)
            system = next(iter(given.values()))
            system = getattr(system, "reduced", system)
            if not rubs and isinstance(system, (Model, ReducedModel)):
                system.require_frictionless(owner)
            body = _body(system)
            outermost, token = not ANALYSIS.get(), ANALYSIS.set(called(owner))
            try:
                result = function(*bound.args, **bound.kwargs)
            finally:
                ANALYSIS.reset(token)
            if outermost:
                warn_if_large(owner, body, result)
            return result

        call.options = options  # type: ignore[attr-defined]
        return agreed()(call)

    return decorated


def _body(system: Any) -> Model | None:
    """The model that an analysis is of: itself or a reduced one."""
    found = system if isinstance(system, Model) else getattr(system, "model", None)
    return found if isinstance(found, Model) else None


def _check_recording(owner: str, given: Mapping[str, Any]) -> None:
    """Arguments of the run, not of its result: where it is kept and whom it tells."""
    if "progress" in given:
        check_progress(owner, given["progress"])
    if given.get("file") is not None:
        path(owner, "file", given["file"])
    if flag(owner, "resume", given.get("resume", False)) and given["file"] is None:
        raise ValueError(f"{owner}: resume = True needs the file to continue, such as file = 'run.h5'")
