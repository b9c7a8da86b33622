"""What a launch file starts, read without `launch`, which is not on PyPI."""

import ast
from collections.abc import Mapping
from pathlib import Path

Parameters = dict[str, object]


def launched_nodes(path: Path, **arguments: str) -> dict[str, Parameters]:
    """Parameters of each executable, with the launch arguments given and else their defaults."""
    tree = ast.parse(path.read_text())
    assigned = {
        each.targets[0].id: each.value for each in ast.walk(tree) if isinstance(each, ast.Assign)
    }
    values = {**_defaults(tree), **arguments}
    found = {}
    for call in _calls(tree, "Node"):
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        assert ast.literal_eval(given["package"]) == "idim_iv_ros"
        assert not {"name", "namespace", "remappings"} & set(given)
        (parameters,) = given["parameters"].elts
        found[ast.literal_eval(given["executable"])] = {
            ast.literal_eval(key): _value(value, assigned, values)
            for key, value in zip(parameters.keys, parameters.values, strict=True)
        }
    return found


def _calls(tree: ast.AST, name: str) -> list[ast.Call]:
    calls = [each for each in ast.walk(tree) if isinstance(each, ast.Call)]
    return [call for call in calls if getattr(call.func, "id", "") == name]


def _defaults(tree: ast.AST) -> dict[str, str]:
    """Of the launch arguments; what must be given, or is made of others, has none here."""
    found = {}
    for call in _calls(tree, "DeclareLaunchArgument"):
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        if isinstance(given.get("default_value"), ast.Constant):
            found[ast.literal_eval(call.args[0])] = ast.literal_eval(given["default_value"])
    return found


def _value(node: ast.expr, assigned: Mapping[str, ast.expr], values: Mapping[str, str]) -> object:
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Name):
        return _value(assigned[node.id], assigned, values)
    assert isinstance(node, ast.Call)
    what = getattr(node.func, "id", "")
    if what == "LaunchConfiguration":
        return values[ast.literal_eval(node.args[0])]
    assert what == "ParameterValue"
    (kind,) = [keyword.value for keyword in node.keywords if keyword.arg == "value_type"]
    text = _value(node.args[0], assigned, values)
    return {"str": str, "bool": {"true": True, "false": False}.__getitem__}[kind.id](text)
