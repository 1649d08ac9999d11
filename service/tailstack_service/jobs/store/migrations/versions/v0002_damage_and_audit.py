"""Hashes of units' results, what was found damaged, and who did what to keys and policies."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

IDENTIFIER = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")


def upgrade() -> None:
    op.add_column("units", sa.Column("result_sha256", sa.Text))
    op.create_table(
        "damages",
        sa.Column("job_id", IDENTIFIER, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("what", sa.Text, nullable=False),
        sa.Column("sha256", IDENTIFIER, nullable=False),
        sa.Column("found_at", sa.Double, nullable=False),
    )
    op.create_index("damages_by_hash", "damages", ["sha256"])
    op.create_table(
        "audit",
        sa.Column("id", IDENTIFIER, primary_key=True),
        sa.Column("at", sa.Double, nullable=False),
        sa.Column("actor", sa.Text, nullable=False),
        sa.Column("action", sa.Text, nullable=False),
        sa.Column("tenant", IDENTIFIER, nullable=False),
        sa.Column("subject", sa.Text, nullable=False),
        sa.Column("detail", sa.Text, nullable=False),
        sa.Column("once", sa.Text),
    )
    op.create_index("audit_of_tenant", "audit", ["tenant", "action", "id"])
    op.create_index("audit_by_time", "audit", ["at"])
    op.create_index("audit_once", "audit", ["once"], unique=True)
