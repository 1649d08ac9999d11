from http import HTTPStatus
from typing import Any, cast
from urllib.parse import quote

import httpx

from ...client import AuthenticatedClient, Client
from ...types import Response, UNSET
from ... import errors

from ...models.get_schema_draft import check_get_schema_draft
from ...models.get_schema_draft import GetSchemaDraft
from ...models.get_schema_response_200 import GetSchemaResponse200
from ...models.problem import Problem
from ...types import UNSET, Unset
from typing import cast


def _get_kwargs(
    name: str,
    *,
    draft: GetSchemaDraft | Unset = "2020-12",
) -> dict[str, Any]:

    params: dict[str, Any] = {}

    json_draft: str | Unset = UNSET
    if not isinstance(draft, Unset):
        json_draft = draft

    params["draft"] = json_draft

    params = {k: v for k, v in params.items() if v is not UNSET and v is not None}

    _kwargs: dict[str, Any] = {
        "method": "get",
        "url": "/v1/schemas/{name}".format(
            name=quote(str(name), safe=""),
        ),
        "params": params,
    }

    return _kwargs


def _parse_response(
    *, client: AuthenticatedClient | Client, response: httpx.Response
) -> GetSchemaResponse200 | Problem | None:
    if response.status_code == 200:
        response_200 = GetSchemaResponse200.from_dict(response.json())

        return response_200

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

    if client.raise_on_unexpected_status:
        raise errors.UnexpectedStatus(response.status_code, response.content)
    else:
        return None


def _build_response(
    *, client: AuthenticatedClient | Client, response: httpx.Response
) -> Response[GetSchemaResponse200 | Problem]:
    return Response(
        status_code=HTTPStatus(response.status_code),
        content=response.content,
        headers=response.headers,
        parsed=_parse_response(client=client, response=response),
    )


def sync_detailed(
    name: str,
    *,
    client: AuthenticatedClient | Client,
    draft: GetSchemaDraft | Unset = "2020-12",
) -> Response[GetSchemaResponse200 | Problem]:
    """One JSON Schema

     The same as tailstack schema NAME prints; with draft=7 as editors read it.

    Args:
        name (str):
        draft (GetSchemaDraft | Unset):  Default: '2020-12'.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[GetSchemaResponse200 | Problem]
    """

    kwargs = _get_kwargs(
        name=name,
        draft=draft,
    )

    response = client.get_httpx_client().request(
        **kwargs,
    )

    return _build_response(client=client, response=response)


def sync(
    name: str,
    *,
    client: AuthenticatedClient | Client,
    draft: GetSchemaDraft | Unset = "2020-12",
) -> GetSchemaResponse200 | Problem | None:
    """One JSON Schema

     The same as tailstack schema NAME prints; with draft=7 as editors read it.

    Args:
        name (str):
        draft (GetSchemaDraft | Unset):  Default: '2020-12'.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        GetSchemaResponse200 | Problem
    """

    return sync_detailed(
        name=name,
        client=client,
        draft=draft,
    ).parsed


async def asyncio_detailed(
    name: str,
    *,
    client: AuthenticatedClient | Client,
    draft: GetSchemaDraft | Unset = "2020-12",
) -> Response[GetSchemaResponse200 | Problem]:
    """One JSON Schema

     The same as tailstack schema NAME prints; with draft=7 as editors read it.

    Args:
        name (str):
        draft (GetSchemaDraft | Unset):  Default: '2020-12'.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        Response[GetSchemaResponse200 | Problem]
    """

    kwargs = _get_kwargs(
        name=name,
        draft=draft,
    )

    response = await client.get_async_httpx_client().request(**kwargs)

    return _build_response(client=client, response=response)


async def asyncio(
    name: str,
    *,
    client: AuthenticatedClient | Client,
    draft: GetSchemaDraft | Unset = "2020-12",
) -> GetSchemaResponse200 | Problem | None:
    """One JSON Schema

     The same as tailstack schema NAME prints; with draft=7 as editors read it.

    Args:
        name (str):
        draft (GetSchemaDraft | Unset):  Default: '2020-12'.

    Raises:
        errors.UnexpectedStatus: If the server returns an undocumented status code and Client.raise_on_unexpected_status is True.
        httpx.TimeoutException: If the request takes longer than Client.timeout.

    Returns:
        GetSchemaResponse200 | Problem
    """

    return (
        await asyncio_detailed(
            name=name,
            client=client,
            draft=draft,
        )
    ).parsed
