"""The database's versions, by Alembic. A change of service/store/models.py comes with a file in versions/."""
