"""Systems that the service works with: nginx, PostgreSQL and PgBouncer, and their faults."""
