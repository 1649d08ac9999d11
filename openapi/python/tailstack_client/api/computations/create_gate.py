from http import HTTPStatus
from typing import Any, cast
from urllib.parse import quote

import httpx

from ...client import AuthenticatedClient, Client
from ...types import Response, UNSET
from ... import errors

from ...models.create_gate_fail_level import check_create_gate_fail_level
from ...models.create_gate_fail_level import CreateGateFailLevel
from ...models.create_gate_mode import check_create_gate_mode
from ...models.create_gate_mode import CreateGateMode
from ...models.create_gate_on_inconclusive import check_create_gate_on_inconclusive
from ...models.create_gate_on_inconclusive import CreateGateOnInconclusive
from ...models.gate import Gate
from ...models.gate_request import GateRequest
from ...models.job import Job
from ...models.problem import Problem
from ...types import UNSET, Unset
from typing import cast


def _get_kwargs(
    *,
    body: GateRequest,
    mode: CreateGateMode | Unset = "auto",
    seed: int | Unset = UNSET,
    fail_level: CreateGateFailLevel | Unset = "error",
    on_inconclusive: CreateGateOnInconclusive | Unset = UNSET,
    prefer: str | Unset = UNSET,
    idempotency_key: str | Unset = UNSET,
) -> dict[str, Any]:
    headers: dict[str, Any] = {}
    if not isinstance(prefer, Unset):
        headers["Prefer"] = prefer

    if not isinstance(idempotency_key, Unset):
        headers["Idempotency-Key"] = idempotency_key

    params: dict[str, Any] = {}

    json_mode: str | Unset = UNSET
    if not isinstance(mode, Unset):
        json_mode = mode

    params["mode"] = json_mode

    params["seed"] = seed

    json_fail_level: str | Unset = UNSET
    if not isinstance(fail_level, Unset):
        json_fail_level = fail_level

    params["fail_level"] = json_fail_level

    json_on_inconclusive: str | Unset = UNSET
    if not isinstance(on_inconclusive, Unset):
        json_on_inconclusive = on_inconclusive

    params["on_inconclusive"] = json_on_inconclusive

    params = {k: v for k, v in params.items() if v is not UNSET and v is not None}

    _kwargs: dict[str, Any] = {
        "method": "post",
        "url": "/v1/gates",
        "params": params,
    }

    _kwargs["json"] = body.to_dict()

    headers["Content-Type"] = "application/json"

    _kwargs["headers"] = headers
    return _kwargs


def _parse_response(*, client: AuthenticatedClient | Client, response: httpx.Response) -> Gate | Job | Problem | None:
    if response.status_code == 200:
        response_200 = Gate.from_dict(response.json())

        return response_200

    if response.status_code == 202:
        response_202 = Job.from_dict(response.json())

        return response_202

    if response.status_code == 400:
        response_400 = Problem.from_dict(response.json())

        return response_400

    if response.status_code == 401:
        response_401 = Problem.from_dict(response.json())

        return response_401

    if response.status_code == 403:
        response_403 = Problem.from_dict(response.json())

        return response_403

    if response.status_code == 408:
        response_408 = Problem.from_dict(response.json())

        return response_408

    if response.status_code == 413:
        response_413 = Problem.from_dict(response.json())

        return response_413

    if response.status_code == 415:
        response_415 = Problem.from_dict(response.json())

        return response_415

    if response.status_code == 421:
        response_421 = Problem.from_dict(response.json())

        return response_421

    if response.status_code == 422:
        response_422 = Problem.from_dict(response.json())

        return response_422

    if response.status_code == 429:
        response_429 = Problem.from_dict(response.json())

        return response_429

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
) -> Response[Gate | Job | Problem]:
    return Response(
        status_code=HTTPStatus(response.status_code),
        content=response.content,
        headers=response.headers,
        parsed=_parse_response(client=client, response=response),
    )


def sync_detailed(
    *,
    client: AuthenticatedClient,
    body: GateRequest,
    mode: CreateGateMode | Unset = "auto",
    seed: int | Unset = UNSET,
    fail_level: CreateGateFailLevel | Unset = "error",
    on_inconclusive: CreateGateOnInconclusive | Unset = UNSET,
    prefer: str | Unset = UNSET,
    idempotency_key: str | Unset = UNSET,
) -> Response[Gate | Job | Problem]:
    """Policy and designs to a verdict

     Mode analytic is answered at once; verify and auto become a job.

    Args:
        mode (CreateGateMode | Unset):  Default: 'auto'.
        seed (int | Unset):
        fail_level (CreateGateFailLevel | Unset):  Default: 'error'.
        on_inconclusive (CreateGateOnInconclusive | Unset):
        prefer (str | Unset):
        idempotency_key (str | Unset):
        body (GateRequest): Body of ``POST /v1/gates``.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[Gate | Job | Problem]
    """

    kwargs = _get_kwargs(
        body=body,
        mode=mode,
        seed=seed,
        fail_level=fail_level,
        on_inconclusive=on_inconclusive,
        prefer=prefer,
        idempotency_key=idempotency_key,
    )

    response = client.get_httpx_client().request(
        **kwargs,
    )

    return _build_response(client=client, response=response)


def sync(
    *,
    client: AuthenticatedClient,
    body: GateRequest,
    mode: CreateGateMode | Unset = "auto",
    seed: int | Unset = UNSET,
    fail_level: CreateGateFailLevel | Unset = "error",
    on_inconclusive: CreateGateOnInconclusive | Unset = UNSET,
    prefer: str | Unset = UNSET,
    idempotency_key: str | Unset = UNSET,
) -> Gate | Job | Problem | None:
    """Policy and designs to a verdict

     Mode analytic is answered at once; verify and auto become a job.

    Args:
        mode (CreateGateMode | Unset):  Default: 'auto'.
        seed (int | Unset):
        fail_level (CreateGateFailLevel | Unset):  Default: 'error'.
        on_inconclusive (CreateGateOnInconclusive | Unset):
        prefer (str | Unset):
        idempotency_key (str | Unset):
        body (GateRequest): Body of ``POST /v1/gates``.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Gate | Job | Problem
    """

    return sync_detailed(
        client=client,
        body=body,
        mode=mode,
        seed=seed,
        fail_level=fail_level,
        on_inconclusive=on_inconclusive,
        prefer=prefer,
        idempotency_key=idempotency_key,
    ).parsed


async def asyncio_detailed(
    *,
    client: AuthenticatedClient,
    body: GateRequest,
    mode: CreateGateMode | Unset = "auto",
    seed: int | Unset = UNSET,
    fail_level: CreateGateFailLevel | Unset = "error",
    on_inconclusive: CreateGateOnInconclusive | Unset = UNSET,
    prefer: str | Unset = UNSET,
    idempotency_key: str | Unset = UNSET,
) -> Response[Gate | Job | Problem]:
    """Policy and designs to a verdict

     Mode analytic is answered at once; verify and auto become a job.

    Args:
        mode (CreateGateMode | Unset):  Default: 'auto'.
        seed (int | Unset):
        fail_level (CreateGateFailLevel | Unset):  Default: 'error'.
        on_inconclusive (CreateGateOnInconclusive | Unset):
        prefer (str | Unset):
        idempotency_key (str | Unset):
        body (GateRequest): Body of ``POST /v1/gates``.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[Gate | Job | Problem]
    """

    kwargs = _get_kwargs(
        body=body,
        mode=mode,
        seed=seed,
        fail_level=fail_level,
        on_inconclusive=on_inconclusive,
        prefer=prefer,
        idempotency_key=idempotency_key,
    )

    response = await client.get_async_httpx_client().request(**kwargs)

    return _build_response(client=client, response=response)


async def asyncio(
    *,
    client: AuthenticatedClient,
    body: GateRequest,
    mode: CreateGateMode | Unset = "auto",
    seed: int | Unset = UNSET,
    fail_level: CreateGateFailLevel | Unset = "error",
    on_inconclusive: CreateGateOnInconclusive | Unset = UNSET,
    prefer: str | Unset = UNSET,
    idempotency_key: str | Unset = UNSET,
) -> Gate | Job | Problem | None:
    """Policy and designs to a verdict

     Mode analytic is answered at once; verify and auto become a job.

    Args:
        mode (CreateGateMode | Unset):  Default: 'auto'.
        seed (int | Unset):
        fail_level (CreateGateFailLevel | Unset):  Default: 'error'.
        on_inconclusive (CreateGateOnInconclusive | Unset):
        prefer (str | Unset):
        idempotency_key (str | Unset):
        body (GateRequest): Body of ``POST /v1/gates``.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Gate | Job | Problem
    """

    return (
        await asyncio_detailed(
            client=client,
            body=body,
            mode=mode,
            seed=seed,
            fail_level=fail_level,
            on_inconclusive=on_inconclusive,
            prefer=prefer,
            idempotency_key=idempotency_key,
        )
    ).parsed
