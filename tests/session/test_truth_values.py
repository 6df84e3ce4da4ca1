"""A truth value is no number, in whatever table of a file it stands."""

import importlib
import pkgutil
from typing import Annotated, Any

import pytest
from pydantic import PydanticUserError, TypeAdapter, ValidationError

import labcdp
import labcdp.drivers
from labcdp.core.errors import InputError
from labcdp.core.photometry import as_quantum_efficiency
from labcdp.evaluate.picture.camera_specification import CameraSpecification
from labcdp.session.tables import ConfigurationTable

#: Where a truth value may be taken for one number, or for numbers in lists and tables.
VALUES = (True, [True, True], [[400, True], [500, 0.5]], {"a": True}, {"a": [True, True]})


def tables():
    """Every kind of table that is read from a file."""
    for package in (labcdp.session, labcdp.evaluate, importlib.import_module("labcdp.drivers.simulated")):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    kinds = [ConfigurationTable]
    for kind in kinds:
        kinds += kind.__subclasses__()
    return kinds[1:]


def test_no_table_takes_true_for_a_number():
    taken, n_fields = [], 0
    for table in tables():
        for name, field in table.model_fields.items():
            kind = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
            try:
                adapter = TypeAdapter(kind, config=table.model_config)
            except PydanticUserError:
                adapter = TypeAdapter(kind)  # a table in this one
            n_fields += 1
            for value in VALUES:
                try:
                    read = adapter.validate_python(value)
                except (ValidationError, InputError):
                    continue
                if field.annotation not in (bool, Any) and repr(read) != repr(value):
                    taken.append((table.__name__, name, value, read))
    assert n_fields > 100
    # Its validator takes the place of the type, and is tested below.
    assert [one for one in taken if one[:2] != (CameraSpecification.__name__, "quantum_efficiency")] == []


@pytest.mark.parametrize(
    "value", [True, [[400, True], [500, 0.2]], [[400, 0.1], [True, 0.2]], [(400, 0.1), (500, False)]]
)
def test_no_quantum_efficiency_takes_true_for_a_number(value):
    with pytest.raises(InputError, match="give a fraction, or at least two pairs"):
        as_quantum_efficiency(value)
