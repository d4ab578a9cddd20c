"""Revisions of the schema, which are read without Alembic."""

from alembic.config import Config
from alembic.script import ScriptDirectory

from service.storage.schema import revisions


def test_revisions_by_file_name_are_those_of_alembic() -> None:
    config = Config()
    config.set_main_option("script_location", "service.storage:migrations")
    scripts = ScriptDirectory.from_config(config)
    assert revisions() == sorted(script.revision for script in scripts.walk_revisions())
    assert revisions()[-1] == scripts.get_current_head()
