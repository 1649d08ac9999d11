from http import HTTPStatus
from typing import Any, cast
from urllib.parse import quote

import httpx

from ...client import AuthenticatedClient, Client
from ...types import Response, UNSET
from ... import errors

from ...models.batch import Batch
from ...models.comparison import Comparison
from ...models.gate import Gate
from ...models.optimisation import Optimisation
from ...models.problem import Problem
from ...models.report import Report
from ...models.study_comparison import StudyComparison
from ...models.study_coupling import StudyCoupling
from ...models.study_estimators import StudyEstimators
from ...models.study_linearity import StudyLinearity
from ...models.study_paper import StudyPaper
from ...models.study_views import StudyViews
from ...models.sweep import Sweep
from ...models.verification import Verification
from ...types import UNSET, Unset
from typing import cast


def _get_kwargs(
    sha256: str,
    *,
    if_none_match: str | Unset = UNSET,
) -> dict[str, Any]:
    headers: dict[str, Any] = {}
    if not isinstance(if_none_match, Unset):
        headers["If-None-Match"] = if_none_match

    _kwargs: dict[str, Any] = {
        "method": "get",
        "url": "/v1/results/{sha256}".format(
            sha256=quote(str(sha256), safe=""),
        ),
    }

    _kwargs["headers"] = headers
    return _kwargs


def _parse_response(
    *, client: AuthenticatedClient | Client, response: httpx.Response
) -> (
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
    | None
):
    if response.status_code == 200:

        def _parse_response_200(
            data: object,
        ) -> (
            Batch
            | Comparison
            | Gate
            | Optimisation
            | Report
            | StudyComparison
            | StudyCoupling
            | StudyEstimators
            | StudyLinearity
            | StudyPaper
            | StudyViews
            | Sweep
            | Verification
        ):
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_0 = Batch.from_dict(data)

                return response_200_type_0
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_1 = Verification.from_dict(data)

                return response_200_type_1
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_2 = Optimisation.from_dict(data)

                return response_200_type_2
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_3 = Sweep.from_dict(data)

                return response_200_type_3
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_4 = StudyPaper.from_dict(data)

                return response_200_type_4
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_5 = StudyLinearity.from_dict(data)

                return response_200_type_5
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_6 = StudyCoupling.from_dict(data)

                return response_200_type_6
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_7 = StudyEstimators.from_dict(data)

                return response_200_type_7
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_8 = StudyViews.from_dict(data)

                return response_200_type_8
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_9 = StudyComparison.from_dict(data)

                return response_200_type_9
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_10 = Gate.from_dict(data)

                return response_200_type_10
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            try:
                if not isinstance(data, dict):
                    raise TypeError()
                response_200_type_11 = Report.from_dict(data)

                return response_200_type_11
            except (TypeError, ValueError, AttributeError, KeyError):
                pass
            if not isinstance(data, dict):
                raise TypeError()
            response_200_type_12 = Comparison.from_dict(data)

            return response_200_type_12

        response_200 = _parse_response_200(response.json())

        return response_200

    if response.status_code == 304:
        response_304 = cast(Any, None)
        return response_304

    if response.status_code == 401:
        response_401 = Problem.from_dict(response.json())

        return response_401

    if response.status_code == 403:
        response_403 = Problem.from_dict(response.json())

        return response_403

    if response.status_code == 404:
        response_404 = Problem.from_dict(response.json())

        return response_404

    if response.status_code == 421:
        response_421 = Problem.from_dict(response.json())

        return response_421

    if response.status_code == 422:
        response_422 = Problem.from_dict(response.json())

        return response_422

    if response.status_code == 500:
        response_500 = Problem.from_dict(response.json())

        return response_500

    if response.status_code == 503:
        response_503 = Problem.from_dict(response.json())

        return response_503

    if client.raise_on_unexpected_status:
        raise errors.UnexpectedStatus(response.status_code, response.content)
    else:
        return None


def _build_response(
    *, client: AuthenticatedClient | Client, response: httpx.Response
) -> Response[
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
]:
    return Response(
        status_code=HTTPStatus(response.status_code),
        content=response.content,
        headers=response.headers,
        parsed=_parse_response(client=client, response=response),
    )


def sync_detailed(
    sha256: str,
    *,
    client: AuthenticatedClient,
    if_none_match: str | Unset = UNSET,
) -> Response[
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
]:
    """A result, which never changes

     It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which record
    it is.

    Args:
        sha256 (str):
        if_none_match (str | Unset):

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[Any | Batch | Comparison | Gate | Optimisation | Report | StudyComparison | StudyCoupling | StudyEstimators | StudyLinearity | StudyPaper | StudyViews | Sweep | Verification | Problem]
    """

    kwargs = _get_kwargs(
        sha256=sha256,
        if_none_match=if_none_match,
    )

    response = client.get_httpx_client().request(
        **kwargs,
    )

    return _build_response(client=client, response=response)


def sync(
    sha256: str,
    *,
    client: AuthenticatedClient,
    if_none_match: str | Unset = UNSET,
) -> (
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
    | None
):
    """A result, which never changes

     It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which record
    it is.

    Args:
        sha256 (str):
        if_none_match (str | Unset):

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Any | Batch | Comparison | Gate | Optimisation | Report | StudyComparison | StudyCoupling | StudyEstimators | StudyLinearity | StudyPaper | StudyViews | Sweep | Verification | Problem
    """

    return sync_detailed(
        sha256=sha256,
        client=client,
        if_none_match=if_none_match,
    ).parsed


async def asyncio_detailed(
    sha256: str,
    *,
    client: AuthenticatedClient,
    if_none_match: str | Unset = UNSET,
) -> Response[
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
]:
    """A result, which never changes

     It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which record
    it is.

    Args:
        sha256 (str):
        if_none_match (str | Unset):

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[Any | Batch | Comparison | Gate | Optimisation | Report | StudyComparison | StudyCoupling | StudyEstimators | StudyLinearity | StudyPaper | StudyViews | Sweep | Verification | Problem]
    """

    kwargs = _get_kwargs(
        sha256=sha256,
        if_none_match=if_none_match,
    )

    response = await client.get_async_httpx_client().request(**kwargs)

    return _build_response(client=client, response=response)


async def asyncio(
    sha256: str,
    *,
    client: AuthenticatedClient,
    if_none_match: str | Unset = UNSET,
) -> (
    Any
    | Batch
    | Comparison
    | Gate
    | Optimisation
    | Report
    | StudyComparison
    | StudyCoupling
    | StudyEstimators
    | StudyLinearity
    | StudyPaper
    | StudyViews
    | Sweep
    | Verification
    | Problem
    | None
):
    """A result, which never changes

     It is named by the SHA-256 of its bytes and may be kept for ever. Its field schema says which record
    it is.

    Args:
        sha256 (str):
        if_none_match (str | Unset):

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Any | Batch | Comparison | Gate | Optimisation | Report | StudyComparison | StudyCoupling | StudyEstimators | StudyLinearity | StudyPaper | StudyViews | Sweep | Verification | Problem
    """

    return (
        await asyncio_detailed(
            sha256=sha256,
            client=client,
            if_none_match=if_none_match,
        )
    ).parsed
