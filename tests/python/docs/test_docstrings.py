"""Docstrings of the public package follow NumPy's convention, and list exactly the parameters that the code has."""

import dataclasses
import functools
import importlib
import inspect
import re
from types import FunctionType

import pecs
import pecs.datasets
import pecs.fit
import pytest
from pecs.datasets import imu, trajectories

MODULES = (pecs, pecs.datasets, imu, trajectories, pecs.fit)
SECTION = re.compile(r"^(\w+)\n-{3,}\n((?:(?!^\w+\n-{3,}\n)(?:.*\n))*)", re.MULTILINE)


def callables():
    """(name, callable, docstring) of functions, of classes, and of their public methods."""
    for value in (getattr(module, name) for module in MODULES for name in module.__all__):
        name = getattr(value, "__name__", "")
        if inspect.isclass(value):
            if {"__init__", "__new__"} & set(vars(value)) and not dataclasses.is_dataclass(value):
                yield name, value, value.__doc__
            names = [k for k, v in vars(value).items() if k[0] != "_" and isinstance(v, (FunctionType, classmethod))]
            yield from ((f"{name}.{key}", getattr(value, key), getattr(value, key).__doc__) for key in names)
        elif inspect.isroutine(value):
            yield name, value, value.__doc__


def expected(call) -> set[str]:
    """Parameters, with the keys of `**options: Unpack[KIND]`; those of `simulate` are described at `Sensor`."""
    found = set()
    for parameter in inspect.signature(call).parameters.values():
        options = re.search(r"Unpack\[(\w+)\]", str(parameter.annotation))
        if options and call is not pecs.simulate:
            found |= set(getattr(importlib.import_module(call.__module__), options[1]).__annotations__)
        elif parameter.name != "self":
            found.add("**options" if options else parameter.name)
    return found


def entries(section: str) -> list[str]:
    listed = re.findall(r"^(\S[^:\n]*?)(?: : .+)?$", section, re.MULTILINE)
    return [part.strip() for line in listed for part in line.split(",")]


@pytest.mark.parametrize(("name", "call", "doc"), [pytest.param(*found, id=found[0]) for found in callables()])
def test_parameters_are_those_of_the_code(name, call, doc):
    text = inspect.cleandoc(doc) + "\n"
    sections = dict(SECTION.findall(text))
    names = entries(sections.get("Parameters", ""))
    assert len(names) == len(set(names)) and set(names) == expected(call)
    summary = text.split("\n\n")[0]
    assert summary.strip().endswith(".") and summary.strip()[0].isupper()


def test_properties_are_described():
    public = [getattr(module, name) for module in MODULES for name in module.__all__]
    classes = [value for value in public if inspect.isclass(value)]
    found = [
        (c, k, v) for c in classes for k, v in vars(c).items() if isinstance(v, (property, functools.cached_property))
    ]
    assert len(found) > 10
    assert not [f"{cls.__name__}.{key}" for cls, key, value in found if key[0] != "_" and not value.__doc__]


OF_FIT = filter(inspect.isclass, map(vars(pecs.fit).get, pecs.fit.__all__))
DESCRIBED = (imu.Errors, imu.Imu, imu.Samples, trajectories.State, *OF_FIT)


@pytest.mark.parametrize("cls", DESCRIBED, ids=lambda cls: cls.__name__)
def test_fields_are_those_of_the_code(cls):
    sections = dict(SECTION.findall(inspect.cleandoc(cls.__doc__) + "\n"))
    listed = entries(sections.get("Parameters", "") + sections.get("Attributes", ""))
    assert listed == [field.name for field in dataclasses.fields(cls)]
