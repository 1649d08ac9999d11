"""Ages as time lived through, which no clock that leaps makes longer."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

AGEING = {"jobs": "jobs_by_end", "designs": "designs_by_time", "audit": None}  # with the index that is no longer used


def upgrade() -> None:
    for table, index in AGEING.items():
        op.add_column(table, sa.Column("aged_from", sa.Double))
        if index is not None:
            op.drop_index(index, table)
        op.create_index(f"{table}_by_age", table, ["aged_from"])
    op.create_table(
        "lifetime",
        sa.Column(
            "id", sa.Integer, sa.CheckConstraint("id = 0", name="lifetime_id"), primary_key=True,
            autoincrement=False,
        ),
        sa.Column("seconds", sa.Double, nullable=False),
        sa.Column("at", sa.Double, nullable=False),
    )  # fmt: skip
