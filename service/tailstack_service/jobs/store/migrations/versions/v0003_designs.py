"""Designs that were sent lately, which requests may name by their hash."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

IDENTIFIER = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")


def upgrade() -> None:
    op.create_table(
        "designs",
        sa.Column("tenant", IDENTIFIER, primary_key=True),
        sa.Column("sha256", IDENTIFIER, primary_key=True),
        sa.Column("body", sa.LargeBinary, nullable=False),
        sa.Column("body_sha256", sa.Text, nullable=False),
        sa.Column("sent_at", sa.Double, nullable=False),
    )
    op.create_index("designs_of_tenant", "designs", ["tenant", "sent_at"])
    op.create_index("designs_by_time", "designs", ["sent_at"])
