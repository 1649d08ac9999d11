"""Jobs, their units, events and results; workers; keys; usage."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

IDENTIFIER = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")


def _job_id() -> "sa.Column[str]":
    return sa.Column("job_id", IDENTIFIER, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True)


def upgrade() -> None:
    op.create_table(
        "results",
        sa.Column("sha256", IDENTIFIER, primary_key=True),
        sa.Column("schema_name", sa.Text, nullable=False),
        sa.Column("body", sa.LargeBinary, nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
    )
    op.create_table(
        "jobs",
        sa.Column("id", IDENTIFIER, primary_key=True),
        sa.Column("tenant", IDENTIFIER, nullable=False),
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("state", sa.Text, nullable=False),
        sa.Column("request_sha256", sa.Text, nullable=False),
        sa.Column("design_name", sa.Text, nullable=False),
        sa.Column("solver_version", sa.Text, nullable=False),
        sa.Column("request_id", sa.Text, nullable=False),
        sa.Column("idempotency_key", sa.Text),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("started_at", sa.Double),
        sa.Column("finished_at", sa.Double),
        sa.Column("units_done", sa.Integer, nullable=False),
        sa.Column("units_expected", sa.Integer, nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        sa.Column("result_sha256", IDENTIFIER, sa.ForeignKey("results.sha256")),
        sa.Column("problem", sa.Text),
        sa.Column("generation", sa.Integer, nullable=False),
        sa.Column("cpu_seconds", sa.Double, nullable=False),
        sa.Column("last_event", sa.Integer, nullable=False),
        sa.CheckConstraint("state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name="jobs_state"),
        sa.CheckConstraint("(state = 'succeeded') = (result_sha256 IS NOT NULL)", name="jobs_result"),
        sa.CheckConstraint("(state = 'failed') = (problem IS NOT NULL)", name="jobs_problem"),
        sa.CheckConstraint("(state IN ('queued', 'running')) = (finished_at IS NULL)", name="jobs_finished"),
    )
    op.create_index("jobs_of_tenant", "jobs", ["tenant", "id"])
    op.create_index("jobs_of_tenant_by_state", "jobs", ["tenant", "state", "id"])
    op.create_index("jobs_of_tenant_by_kind", "jobs", ["tenant", "kind", "id"])
    op.create_index("jobs_by_idempotency_key", "jobs", ["tenant", "idempotency_key"], unique=True)
    op.create_index("jobs_by_result", "jobs", ["result_sha256", "tenant"])
    op.create_index("jobs_by_end", "jobs", ["finished_at"])
    op.create_table("requests", _job_id(), sa.Column("body", sa.LargeBinary, nullable=False))
    op.create_table(
        "units",
        _job_id(),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("advance", sa.Boolean, nullable=False),
        sa.Column("state", sa.Text, nullable=False),
        sa.Column("place", sa.Double, nullable=False),
        sa.Column("ready_at", sa.Double, nullable=False),
        sa.Column("spec", sa.LargeBinary),
        sa.Column("token", sa.Integer, nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("deaths", sa.Integer, nullable=False),
        sa.Column("worker_id", sa.Text),
        sa.Column("lease_until", sa.Double),
        sa.Column("result", sa.LargeBinary),
        sa.Column("cpu_seconds", sa.Double, nullable=False),
        sa.CheckConstraint("state IN ('ready', 'leased', 'recorded')", name="units_state"),
    )
    _partial_index("units_ready", ["place", "job_id", "number"], "state = 'ready'")
    _partial_index("units_leased", ["lease_until"], "state = 'leased'")
    _partial_index("units_open", ["job_id"], "state <> 'recorded'")
    op.create_table(
        "events",
        _job_id(),
        sa.Column("sequence", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("at", sa.Double, nullable=False),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
    )
    op.create_table(
        "workers",
        sa.Column("id", IDENTIFIER, primary_key=True),
        sa.Column("host", sa.Text, nullable=False),
        sa.Column("pid", sa.Integer, nullable=False),
        sa.Column("solver_version", sa.Text, nullable=False),
        sa.Column("engine", sa.Text, nullable=False),
        sa.Column("capacity", sa.Integer, nullable=False),
        sa.Column("started_at", sa.Double, nullable=False),
        sa.Column("seen_at", sa.Double, nullable=False),
    )
    op.create_table(
        "keys",
        sa.Column("id", IDENTIFIER, primary_key=True),
        sa.Column("tenant", IDENTIFIER, nullable=False),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("scopes", sa.Text, nullable=False),
        sa.Column("secret_sha256", sa.Text, nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("expires_at", sa.Double, nullable=False),
        sa.Column("revoked_at", sa.Double),
    )
    op.create_table(
        "usage",
        sa.Column("tenant", IDENTIFIER, primary_key=True),
        sa.Column("minute", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("units", sa.Integer, nullable=False),
        sa.Column("cpu_seconds", sa.Double, nullable=False),
    )


def _partial_index(name: str, columns: list[str], condition: str) -> None:
    where = sa.text(condition)
    op.create_index(name, "units", columns, sqlite_where=where, postgresql_where=where)
