"""Database migrations with Alembic. Each change of service/store/models.py needs a file in versions/."""
