"""Parameters of a node from one table: name, default, meaning, unit, range. YAML, checks and descriptors
follow it.

`python -m geodesic_motion_ros.nodes.parameters planner` prints the parameter file of a node, `page` in the place of its
name the page `doc/parameters.md`; a test holds `config/` and `doc/` to them.
"""

from __future__ import annotations

import argparse
import difflib
import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from geodesic_motion_ros.utils.errors import ParameterError

Value = bool | int | float | str | list[float] | list[str]

_LONGEST_VALUE = 40
_PAGE_HEAD = """# Parameters

Every parameter of the nodes: what the code declares, with its default, range and unit. Ranges include their ends.
A parameter marked *start only* is set when the node starts; the others change while it runs
(`ros2 param set /planner speed_override 0.5`). What does not fit is refused, with what is allowed. The same as files to
copy: `config/NODE.yaml`. `paper_planner --help` lists those of the paper's planner.

<!-- generated: python -m geodesic_motion_ros.nodes.parameters page > doc/parameters.md -->
"""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Attributes
    ----------
    default : its type is the parameter's type: bool, int, float, str, a list of floats, or one of texts. ROS has no
        lists without a type: one of texts that holds none is [""].
    lowest, highest : range of a number, or of every number in a list; both ends included.
    row : a list must hold one or more whole rows of this many numbers; 0: as many numbers as the default.
    choices : the texts allowed, in a list beside ""; empty for any.
    read_only : whether it can be set at start only.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    lowest: float | None = None
    highest: float | None = None
    row: int = 0
    choices: tuple[str, ...] = ()
    read_only: bool = True

    def as_declared(self, value: object) -> object:
        """Return a value with its integers as floats where floats are declared: 1 is how people write 1.0.

        ROS knows a type for each parameter, and hands out arrays as array.array; a list compares and prints like one.
        """
        value = _plain(value)
        if type(self.default) is float:
            return _as_float(value)
        if isinstance(self.default, list) and not self._of_texts and isinstance(value, list):
            return [_as_float(number) for number in value]
        return value

    def check(self, value: object) -> None:
        """Raise ParameterError, naming parameter, value and what is allowed, when a value does not fit."""
        if self._of_texts:
            self._check_texts(value)
        elif isinstance(self.default, list):
            self._check_list(value)
        else:
            self._check_scalar(value)

    @property
    def _of_texts(self) -> bool:
        return isinstance(self.default, list) and isinstance(self.default[0], str)

    def _check_texts(self, value: object) -> None:
        if value is None or value == []:
            self._refuse(value, '; an empty list has no type in ROS, write [""]')
        if not isinstance(value, list):
            self._refuse(value)
        for text in value:
            if text not in ("", *self.choices):
                # A topic is named as the node does, whatever it resolves to in the graph.
                plain = str(text).rpartition("/")[2]
                self._refuse(value, f"; write {plain}, without a slash" if plain in self.choices else "")

    def _check_list(self, value: object) -> None:
        if not isinstance(value, list) or not all(type(number) is float for number in value):
            self._refuse(value)
        whole = len(value) % self.row == 0 < len(value) if self.row else len(value) == len(self.default)
        if not whole:
            self._refuse(value)
        for number in value:
            self._check_range(number, value)

    def _check_scalar(self, value: object) -> None:
        if type(value) is not type(self.default):
            self._refuse(value)
        if isinstance(value, float) or type(value) is int:
            self._check_range(value, value)
        if self.choices and value not in self.choices:
            self._refuse(value)

    def _check_range(self, number: float, value: object) -> None:
        low = -math.inf if self.lowest is None else self.lowest
        high = math.inf if self.highest is None else self.highest
        if not (math.isfinite(number) and low <= number <= high):
            self._refuse(value)

    def _refuse(self, value: object, hint: str = "") -> None:
        shown = "[]" if value is None else repr(value)  # rclpy's value of an empty list
        raise ParameterError(f"parameter {self.name} = {shown}: expected {self.allowed}{hint}")

    @property
    def allowed(self) -> str:
        """The values that are allowed, in words."""
        if self._of_texts:
            return f'a list of {", ".join(self.choices)}; [""] for none'
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if isinstance(self.default, list):
            count = {0: str(len(self.default)), 1: "one or more"}.get(self.row, f"rows of {self.row}")
            return f"{count} floats{self._range_text}{self._unit_text}"
        kinds = {bool: "true or false", int: "an integer", float: "a float", str: "a text"}
        return kinds[type(self.default)] + self._range_text + self._unit_text

    @property
    def _range_text(self) -> str:
        if self.lowest is None and self.highest is None:
            return ""
        if self.highest is None:
            return f", at least {self.lowest:g}"
        return f" from {self.lowest:g} to {self.highest:g}"

    @property
    def _unit_text(self) -> str:
        return f" [{self.unit}]" if self.unit else ""

    def descriptor(self) -> ParameterDescriptor:
        """Return the ROS descriptor; a range is declared when both ends are known."""
        descriptor = ParameterDescriptor(description=f"{self.description}{self._unit_text}", read_only=self.read_only)
        if self.choices:
            descriptor.additional_constraints = self.allowed
        if self.lowest is not None and self.highest is not None:
            low, high = self.lowest, self.highest
            if type(self.default) is float:
                descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
            elif type(self.default) is int:
                descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        return descriptor


class NodeParameters:
    """The declared parameters of a node and their present values.

    Raises ParameterError at construction when the node was started with a parameter that does not exist or
    a value that does not fit. Later changes are checked all or nothing; reading gives a consistent snapshot.

    Parameters
    ----------
    check : is given all values as they would be after a change; raises ParameterError to refuse it.
    changed : called after values have changed, with all of them.
    """

    def __init__(
        self,
        node: Node,
        table: Sequence[Parameter],
        check: Callable[[Mapping[str, Value]], None] = lambda values: None,
        changed: Callable[[Mapping[str, Value]], None] = lambda values: None,
    ) -> None:
        self._table = {parameter.name: parameter for parameter in table}
        self._check, self._changed, self._log = check, changed, node.get_logger().error
        # rclpy has no public view of what a node was started with, and silently ignores what was never
        # declared.
        overrides = node._parameter_overrides
        self._refuse_unknown(node, overrides)
        for parameter in table:
            if parameter.name in overrides:
                value = parameter.as_declared(overrides[parameter.name].value)
                overrides[parameter.name] = RosParameter(parameter.name, value=value)
        self._refuse_unfit({name: item.value for name, item in overrides.items() if name in self._table})
        node.declare_parameters(
            "", [(parameter.name, parameter.default, parameter.descriptor()) for parameter in table]
        )
        self._values = {name: _plain(node.get_parameter(name).value) for name in self._table}
        check(self._values)
        node.add_pre_set_parameters_callback(self._as_declared)
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._accept)

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def stand_in(self, values: Mapping[str, Value]) -> None:
        """Let these be read in the place of what was declared, until that is set to something else."""
        self._values = {**self._values, **values}

    @property
    def values(self) -> Mapping[str, Value]:
        return MappingProxyType(self._values)

    def _as_declared(self, changes: Sequence[RosParameter]) -> list[RosParameter]:
        return [
            RosParameter(change.name, value=self._table[change.name].as_declared(change.value))
            if change.name in self._table
            else change
            for change in changes
        ]

    def _refuse_unknown(self, node: Node, overrides: Mapping[str, object]) -> None:
        for name in overrides:
            if name in self._table or node.has_parameter(name) or name.startswith("qos_overrides."):
                continue
            close = difflib.get_close_matches(name, self._table, n=1)
            hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(self._table)}"
            raise ParameterError(f"parameter {name} does not exist; {hint}")

    def _refuse_unfit(self, values: Mapping[str, object]) -> None:
        """Name all that do not fit at once."""
        errors = []
        for name, value in values.items():
            try:
                self._table[name].check(_plain(value))
            except ParameterError as error:
                errors.append(str(error))
        if errors:
            raise ParameterError("; ".join(sorted(errors)))

    def _after(self, changes: Sequence[RosParameter]) -> dict[str, Value]:
        known = {change.name: _plain(change.value) for change in changes if change.name in self._table}
        return {**self._values, **known}

    def _judge(self, changes: Sequence[RosParameter]) -> SetParametersResult:
        try:
            if not all(change.name for change in changes):
                raise ParameterError(f"a parameter without a name does not exist; known: {', '.join(self._table)}")
            for change in changes:
                if change.name in self._table:
                    self._table[change.name].check(_plain(change.value))
            self._check(self._after(changes))
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:  # a value that nobody thought of must not end the node
            self._log("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)
            return SetParametersResult(successful=False, reason=f"internal error, see the log: {error!r}")
        return SetParametersResult(successful=True)

    def _accept(self, changes: Sequence[RosParameter]) -> None:
        self._values = self._after(changes)
        self._changed(self._values)


def _plain(value: object) -> Value:
    return value.tolist() if hasattr(value, "tolist") else value


def _as_float(value: object) -> object:
    return float(value) if type(value) is int else value


def yaml_document(node_name: str, table: Sequence[Parameter]) -> str:
    """Return the commented parameter file of a node, all defaults, for any namespace."""
    lines = [
        f"# Every parameter of the node `{node_name}` with its default.",
        "# Units stand in brackets, ranges include their ends.",
        '# "start only" marks what cannot be changed while the node runs.',
        f"/**/{node_name}:",
        "  ros__parameters:",
    ]
    for parameter in table:
        lines.append(f"    # {parameter.description}{_remarks(parameter)}")
        lines.append(f"    {parameter.name}: {_yaml_value(parameter.default)}")
    return "\n".join(lines) + "\n"


def _remarks(parameter: Parameter) -> str:
    remarks = [f"[{parameter.unit}]"] if parameter.unit else []
    if parameter.lowest is not None and parameter.highest is not None:
        remarks.append(f"{parameter.lowest:g} to {parameter.highest:g}")
    if parameter.read_only:
        remarks.append("start only")
    return f" ({', '.join(remarks)})" if remarks else ""


def markdown_table(table: Sequence[Parameter]) -> str:
    """Return the parameters of a node for people."""
    lines = ["| parameter | default | allowed | when | meaning |", "|---|---|---|---|---|"]
    for parameter in table:
        when = "start only" if parameter.read_only else "at any time"
        default = short_text(parameter.default)
        lines.append(f"| `{parameter.name}` | {default} | {parameter.allowed} | {when} | {parameter.description} |")
    return "\n".join(lines) + "\n"


def markdown_page(tables: Mapping[str, Sequence[Parameter]]) -> str:
    """Return the page of the parameters of all nodes, by the names of these."""
    sections = [f"## {node}\n\n{markdown_table(table)}" for node, table in tables.items()]
    return "\n".join([_PAGE_HEAD, *sections])


def short_text(value: Value) -> str:
    """Return a value as a parameter file has it, and no more of it than fits into a line."""
    text = f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else str(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


def main() -> None:
    """Print the parameter file of a node, or the page of the parameters of all."""
    from geodesic_motion_ros.nodes.parameter_tables import TABLES

    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("node", choices=[*TABLES, "page"])
    node = parser.parse_args().node
    print(markdown_page(TABLES) if node == "page" else yaml_document(node, TABLES[node]), end="")


def _yaml_value(value: Value) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()


if __name__ == "__main__":
    main()
