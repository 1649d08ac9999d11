"""What the operations that are studies of one design share: their parts are found by the name of the study."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .operation import Call, FigureFile, LateImport, Operation, refuse_unknown_target, run_function, within

if TYPE_CHECKING:
    from ..settings import Settings
    from .request import Request


def refuse_undetermined(request: Request) -> None:
    """A design that determines an answer, and a target that it has.  Raises RefusedAt, RequestError."""
    from tailstack.design import check_design

    system, _, _ = request.refuse_by(check_design)
    refuse_unknown_target(getattr(request.options, "target", None), [each.name for each in system.targets], "/target")


def study_operation(
    name: str,
    *,
    verb: str = "",
    module: str = "",
    figure: str = "",
    threads: bool = True,
    check: Callable[[Request], None] = refuse_undetermined,
    arguments: Callable[[Call], dict[str, Any]] = Call.arguments,
    **more: Any,
) -> Operation:
    """The operation of the study of this name.

    In ``tailstack.studies.NAME`` stand ``study_NAME(design, **arguments, threads=, progress=)`` and its record
    ``StudyName``, in ``report/studies/NAME.py`` ``NAME_document`` and ``draw_NAME``; ``module`` is that of both where
    it is not called so.  verb: behind "study", where it is not the name.  figure: what the chart shows; empty: there is
    none.  check: raises RefusedAt, RequestError, TailstackError; trials and starts are checked here.  more: fields of
    the operation.
    """
    module, verb = module or name, verb or name
    solver, report = f"tailstack.studies.{module}", f"..report.studies.{module.partition('.')[0]}"
    passed = ("threads", "progress") if threads else ("progress",)

    def check_request(request: Request, settings: Settings) -> None:
        within(getattr(request.options, "trials", None), "max_trials", settings, "/trials")
        within(getattr(request.options, "starts", None), "max_starts", settings, "/starts")
        check(request)

    return Operation(
        name=f"study-{name}",
        verb=f"study {verb}",
        path=f"/v1/studies/{verb}",
        record=LateImport(solver, f"Study{name.title()}").load,
        run=run_function(LateImport(solver, f"study_{name}"), *passed, arguments=arguments),
        check=check_request,
        document=LateImport(report, f"{name}_document"),
        threads=threads,
        figure=FigureFile(figure, LateImport(report, f"draw_{name}")) if figure else None,
        **more,
    )
