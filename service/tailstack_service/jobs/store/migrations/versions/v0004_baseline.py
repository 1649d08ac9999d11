"""The tables of 0.2, which every database begins with: ``schema.py`` makes them as ``tables.py`` has them."""

revision = "0004"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Nothing: what comes before is not brought up to date."""
