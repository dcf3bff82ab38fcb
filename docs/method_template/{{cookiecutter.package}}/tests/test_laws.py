"""The method holds all that every method of eaves must hold."""

from eaves.testing import check_method
from {{ cookiecutter.package }} import {{ cookiecutter.class_name }}


def test_laws() -> None:
    check_method({{ cookiecutter.class_name }})
