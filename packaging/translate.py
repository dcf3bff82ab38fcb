"""Kernels as C: the part of Python and numpy that kernels use, in C of 1999.

A kernel is translated for the sorts of its arguments. Types are found as numba finds them: a name has one type,
that to which all it is given convert; numbers are as wide as numba makes them; a float or a whole number divided
by zero raises. Arrays are views on counted memory; what is computed on whole arrays becomes loops over cells.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import textwrap
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from eaves.kernels import Kernel, named, words_of

C_OF = {
    "f8": "double", "f4": "float", "i8": "int64_t", "i4": "int32_t", "u8": "uint64_t", "u2": "uint16_t",
    "u1": "uint8_t", "b1": "uint8_t",
}  # fmt: skip
"""Kind of a number → its type in C."""
SIZES = {"f8": 8, "f4": 4, "i8": 8, "i4": 4, "u8": 8, "u2": 2, "u1": 1, "b1": 1}
NUMBERS = {"float": "f8", "int": "i8", "bool": "b1", "float32": "f4"}
DTYPES = {
    np.float64: "f8", np.float32: "f4", np.int64: "i8", np.int32: "i4", np.uint8: "u1", np.bool_: "b1",
    np.uint64: "u8", np.uint16: "u2", float: "f8", int: "i8", bool: "b1",
}  # fmt: skip
WIDER = ("b1", "u1", "u2", "i4", "i8", "f4", "f8")
RESERVED = {
    *("double float int long short char signed unsigned register auto static const if else for while do switch"
      " case break continue return goto sizeof struct union enum void default inline restrict volatile").split(),
    *("at cut keep take kept shaped zeroed wrap clamped reversed raveled quotient floored modulo square raise"
      " pack bad raised out done table kinds sizes minimum maximum y0 y1 j0 j1 yn jn gamma index call").split(),
}  # fmt: skip
OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
    ast.LShift: "<<", ast.RShift: ">>", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^",
}  # fmt: skip
COMPARISONS = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
OF_FLOATS = {"sqrt": "sqrt", "floor": "floor", "rint": "rint", "round": "rint", "sin": "sin", "cos": "cos",
             "log": "log", "exp": "exp", "arctan2": "atan2", "hypot": "hypot", "mod": "remainder_of",
             "minimum": "minimum", "maximum": "maximum"}  # fmt: skip
"""Function of numpy → that of C on doubles."""


class Untranslated(Exception):
    """What a kernel does that C is not made of."""


@dataclass(frozen=True)
class Arr:
    """The type of an array: kind of its cells, axes, whether they lie row by row, whether on whole addresses."""

    kind: str
    axes: int
    rows: bool = True
    aligned: bool = True


@dataclass(frozen=True)
class Tup:
    """The type of a tuple, of a named one with the names of its fields."""

    items: tuple[Any, ...]
    names: tuple[str, ...] = ()


RANGE, NOTHING = "range", "void"


@dataclass
class Value:
    """An expression in C.

    `parts` are the items of a tuple that is not made yet; `cell` gives the cell of an array that is not made
    yet at some indices, `shape` the lengths of its axes ("1" is repeated); `fresh` marks an array that nothing
    holds yet; `roots` are the names that hold the memory of a view.
    """

    code: str
    type: Any
    natural: bool = False
    constant: Any = None
    parts: list[Value] | None = None
    cell: Callable[[list[str]], Value] | None = None
    shape: list[str] = field(default_factory=list)
    fresh: bool = False
    roots: list[str] = field(default_factory=list)


def type_of(sort: str) -> Any:
    """The type of an argument of a sort, as lists of calls name them."""
    if sort.endswith("]"):
        kind, layout = sort[1:-1].split("[")
        return Arr(kind, int(layout[0]), layout[1] == "C", not layout.endswith("u"))
    if sort.endswith(")"):
        name, words = sort[:-1].split("(", 1)
        items = tuple(map(type_of, words_of(words)))
        return Tup(items, named(name)._fields if name else ())
    return NUMBERS[sort]


def unified(one: Any, other: Any) -> Any:
    """The type to which values of two types convert."""
    if one is None or one == other:
        return other
    if isinstance(one, Arr) and isinstance(other, Arr) and (one.kind, one.axes) == (other.kind, other.axes):
        return Arr(one.kind, one.axes, one.rows and other.rows, one.aligned and other.aligned)
    if isinstance(one, Tup) and isinstance(other, Tup) and len(one.items) == len(other.items):
        return Tup(tuple(map(unified, one.items, other.items)), one.names)
    if isinstance(one, str) and isinstance(other, str) and {one, other} <= set(WIDER):
        if {one, other} & {"f4"} and {one, other} & {"i4", "i8"}:
            return "f8"
        return max(one, other, key=WIDER.index)
    raise Untranslated(f"{one} and {other} in one name")


def has_arrays(type_: Any) -> bool:
    """True if values of a type hold memory."""
    return isinstance(type_, Arr) or (isinstance(type_, Tup) and any(map(has_arrays, type_.items)))


@dataclass
class Function:
    """A kernel for some types: its name in C, what it returns, its text, the functions that it calls."""

    name: str
    returns: Any
    can_fail: bool
    text: str
    calls: list[Function]


class Translator:
    """All functions, structs and tables of one file."""

    def __init__(self) -> None:
        self.functions: dict[Any, Function] = {}
        self.structs: dict[Tup, str] = {}
        self.names: set[str] = set()
        self.tables: dict[str, tuple[str, str]] = {}

    def function(self, kernel: Any, types: tuple[Any, ...]) -> Function:
        """A kernel for some types of arguments."""
        key = kernel.name, types
        if key not in self.functions:
            name = stem = "_".join(kernel.name.split(".")[-2:])
            while name in self.names:
                name = f"{stem}_{sum(one.startswith(stem) for one in self.names) + 1}"
            self.names.add(name)
            self.functions[key] = Body(self, kernel, types, name).function()
        return self.functions[key]

    def c_type(self, type_: Any) -> str:
        """The name of a type in C."""
        if isinstance(type_, Arr):
            return "Array"
        if isinstance(type_, Tup):
            plain = Tup(tuple(self.plain(item) for item in type_.items))
            return self.structs.setdefault(plain, f"Tuple{len(self.structs)}")
        return "Range" if type_ == RANGE else C_OF.get(type_, type_)

    def plain(self, type_: Any) -> Any:
        """A type by what C tells apart."""
        if isinstance(type_, Arr):
            return Arr("", 0)
        return Tup(tuple(map(self.plain, type_.items))) if isinstance(type_, Tup) else type_

    def struct_texts(self) -> list[str]:
        """The structs, those within others first."""
        texts = []
        for struct, name in self.structs.items():
            fields = "".join(f" {self.c_type(item)} f{k};" for k, item in enumerate(struct.items))
            texts.append(f"typedef struct {{{fields} }} {name};")
        return texts

    def table(self, values: np.ndarray) -> Value:
        """A constant array."""
        kind = values.dtype.str[1:]
        content = ", ".join(literal(one, kind) for one in values.ravel().tolist())
        name, _ = self.tables.setdefault(
            content,
            (f"table_{len(self.tables)}", f"static {C_OF[kind]} table_{len(self.tables)}[] = {{{content}}};"),
        )
        n = [*values.shape, 0, 0][:3]
        s = [*values.strides, 0, 0][:3]
        code = f"(Array){{(char *){name}, {', '.join(map(str, n + s))}, NULL}}"
        return Value(code, Arr(kind, values.ndim))


def literal(value: Any, kind: str) -> str:
    """A number as C writes it."""
    if kind in ("f8", "f4"):
        value = float(value)
        word = "NAN" if math.isnan(value) else "INFINITY" if math.isinf(value) else repr(abs(value))
        return f"-{word}" if math.copysign(1.0, value) < 0 else word
    if kind == "u8":
        return f"{int(value)}ull"
    return str(int(value)) if -(2**31) < int(value) < 2**31 else f"{int(value)}ll"


@functools.cache
def parsed(function: Callable[..., Any]) -> tuple[Any, Counter[str], set[str]]:
    """The syntax of a function, how often names are given values in it, and which are in loops."""
    tree: Any = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assigned: Counter[str] = Counter()
    in_loops: set[str] = set()
    waiting: list[tuple[ast.AST, bool]] = [(tree, False)]
    while waiting:
        node, within = waiting.pop()
        within = within or isinstance(node, ast.For | ast.While)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            assigned[node.id] += 1
            in_loops |= {node.id} if within else set()
        waiting += [(inner, within) for inner in ast.iter_child_nodes(node)]
    return tree, assigned, in_loops


class Body:
    """The translation of one kernel for some types of its arguments."""

    def __init__(self, whole: Translator, kernel: Any, types: tuple[Any, ...], name: str) -> None:
        function = kernel.py_func
        self.inline = kernel.targetoptions["inline"] == "always"
        self.whole, self.name, self.globals = whole, name, function.__globals__
        self.tree, self.assigned, in_loops = parsed(function)
        self.arguments = [one.arg for one in self.tree.args.args]
        if len(types) != len(self.arguments):
            raise Untranslated(f"{name} of {len(types)} arguments")
        self.types: dict[str, Any] = dict(zip(self.arguments, types, strict=True))
        self.natural: dict[str, bool] = dict.fromkeys(self.arguments, False)
        self.returns: Any = None
        self.steady = {
            name
            for name in {*self.assigned, *self.arguments}
            if self.assigned[name] + (name in self.arguments) == 1 and name not in in_loops
        }
        self.borrowed: dict[str, bool] = {}
        self.calls: list[Function] = []

    # The whole

    def function(self) -> Function:
        """Translate again and again, until the types of all names stay as they are."""
        for _ in range(12):
            state = dict(self.types), dict(self.natural), self.returns, dict(self.borrowed)
            self.lines: list[str] = []
            self.depth, self.number = 1, 0
            self.slots: dict[str, Any] = {}
            self.calls = []
            self.can_fail = self.divides = self.jumps = False
            self.risk = False
            for statement in self.tree.body[1:] if ast.get_docstring(self.tree) else self.tree.body:
                self.statement(statement)
            if state == (self.types, self.natural, self.returns, self.borrowed):
                break
        else:
            raise Untranslated(f"{self.name}: types do not settle")
        self.returns = self.returns or NOTHING
        return Function(self.name, self.returns, self.can_fail, self.text(), self.calls)

    def text(self) -> str:
        """The function in C."""
        c_type, returns = self.whole.c_type, self.returns
        words = [f"{c_type(self.types[a])} {safe(a)}" for a in self.arguments]
        words += ["int *out_bad"] if self.can_fail else []
        head = f"{'INLINE' if self.inline else 'KERNEL'} {c_type(returns)} {self.name}({', '.join(words) or 'void'}) {{"
        lines = [head]
        for name, type_ in {**self.types, **self.slots}.items():
            if name not in self.arguments and type_ is not None:
                zero = "0" if isinstance(type_, str) and type_ != RANGE else "{0}"
                lines.append(f"    {c_type(type_)} {safe(name)} = {zero};")
        if self.can_fail:
            lines.append("    int bad = 0, raised = 0;")
        if returns != NOTHING:
            lines.append(f"    {c_type(returns)} out = {'0' if isinstance(returns, str) else '{0}'};")
        for name in self.arguments:
            if self.owns(name):
                lines.append(f"    Py_XINCREF({safe(name)}.owner);")
        lines += self.lines
        drops = [
            drop for name, type_ in {**self.types, **self.slots}.items()
            if (name in self.slots or self.owns(name)) for drop in drops_of(safe(name), type_)
        ]  # fmt: skip
        if self.jumps:
            lines.append("done:;")
        lines += [f"    {drop}" for drop in drops]
        if self.can_fail:
            lines.append("    if (bad | raised) *out_bad = bad ? bad : raised;")
        if returns != NOTHING:
            lines.append("    return out;")
        return "\n".join([*lines, "}"])

    def owns(self, name: str) -> bool:
        """True if a name counts as a holder of its array's memory."""
        if not has_arrays(self.types.get(name)) or self.borrowed.get(name, False):
            return False
        return name not in self.arguments or name in self.assigned

    # Lines

    def put(self, line: str) -> None:
        """Add a line."""
        self.lines.append("    " * self.depth + line)

    @contextmanager
    def block(self, head: str) -> Any:
        """Lines within braces."""
        self.put(head + " {")
        self.depth += 1
        yield
        self.depth -= 1
        self.put("}")

    def check(self) -> None:
        """Leave the kernel if what came before failed."""
        if self.risk:
            self.can_fail = self.jumps = True
            self.put("if (bad | raised) goto done;")
            self.risk = False

    def may_fail(self) -> str:
        """The flag of a failure, as an argument."""
        self.risk = self.can_fail = True
        return "&bad"

    def new(self, type_: Any, code: str = "") -> str:
        """A name for a value that is used within its block."""
        self.number += 1
        name = f"_{self.number}"
        self.put(f"{self.whole.c_type(type_)} {name}{' = ' + code if code else ''};")
        return name

    def slot(self, type_: Any) -> str:
        """A name that holds memory until it is given other, or the kernel ends."""
        self.number += 1
        self.slots[f"_{self.number}"] = type_
        return f"_{self.number}"

    # Statements

    def statement(self, node: Any) -> None:
        """One statement."""
        getattr(self, f"on_{type(node).__name__}")(node)

    def statements(self, nodes: list[Any]) -> None:
        """Some statements."""
        for node in nodes:
            self.statement(node)

    def on_Expr(self, node: Any) -> None:
        """A call for what it does, or a docstring."""
        if isinstance(node.value, ast.Constant):
            return
        call = node.value
        if isinstance(call.func, ast.Attribute) and call.func.attr == "sort":
            array = self.made(self.value(call.func.value))
            self.put(f"quick_{array.type.kind}(NULL, 0, (void *){array.code}.p, {array.code}.n0);")
            return
        value = self.value(call)
        if has_arrays(value.type):
            raise Untranslated("an array that nothing takes")
        self.put(f"{value.code};")
        self.check()

    def on_Pass(self, node: Any) -> None:
        """Nothing."""

    def on_Break(self, node: Any) -> None:
        """The end of a loop."""
        self.put("break;")

    def on_Continue(self, node: Any) -> None:
        """The next round of a loop."""
        self.put("continue;")

    def on_Return(self, node: Any) -> None:
        """The result."""
        self.jumps = True
        if node.value is not None:
            value = self.value(node.value)
            self.returns = unified(self.returns, self.solid(value.type))
            self.check()
            self.give("out", value, self.returns)
            self.check()
        self.put("goto done;")

    def solid(self, type_: Any) -> Any:
        """The type of a value once it is in a name."""
        return type_

    def give(self, target: str, value: Value, type_: Any) -> None:
        """Put a value into an empty place, which holds its memory from then on."""
        if isinstance(type_, Tup):
            for k, item in enumerate(type_.items):
                self.give(f"{target}.f{k}", self.item(value, k), item)
        elif isinstance(type_, Arr):
            value = self.made(value, fresh=True)
            self.put(f"{target} = {value.code if value.fresh else f'kept({value.code})'};")
        else:
            self.put(f"{target} = {self.as_(value, type_)};")

    def on_If(self, node: Any) -> None:
        """A choice."""
        test = self.truth(self.value(node.test))
        if self.risk:
            test = self.new("b1", test)
            self.check()
        with self.block(f"if ({bare(test)})"):
            self.statements(node.body)
        if node.orelse:
            with self.block("else"):
                self.statements(node.orelse)

    def on_While(self, node: Any) -> None:
        """A loop while something holds."""
        begin = len(self.lines)
        test = self.truth(self.value(node.test))
        if len(self.lines) == begin and not self.risk:
            with self.block(f"while ({bare(test)})"):
                self.statements(node.body)
            return
        del self.lines[begin:]
        with self.block("for (;;)"):
            test = self.truth(self.value(node.test))
            if self.risk:
                test = self.new("b1", test)
                self.check()
            self.put(f"if (!({bare(test)})) break;")
            self.statements(node.body)

    def on_For(self, node: Any) -> None:
        """A loop over numbers, the cells or rows of an array, or the items of a tuple."""
        source, target, counter = node.iter, node.target, None
        if is_call(source, "enumerate"):
            counter, target, source = target.elts[0], target.elts[1], source.args[0]
        value = self.value(source)
        self.check()
        if value.type == RANGE:
            self.for_range(value, target, node.body)
        elif isinstance(value.type, Tup):
            self.for_items(value, target, node.body)
        else:
            stored = {n.id for one in node.body for n in ast.walk(one) if isinstance(n, ast.Name)
                      and isinstance(n.ctx, ast.Store)}  # fmt: skip
            array = self.stored(value) if stored & {*value.roots} else self.named_array(value)
            place = self.new("i8")
            with self.block(f"for ({place} = 0; {place} < {array.code}.n0; {place}++)"):
                here = Value(place, "i8", natural=True)
                if counter is not None:
                    self.assign(counter, here)
                self.assign(target, self.element(array, [here]))
                self.statements(node.body)

    def for_range(self, value: Value, target: Any, body: list[Any]) -> None:
        """A loop over whole numbers."""
        if value.parts is None:
            name = self.new(RANGE, value.code)
            parts = [Value(f"{name}.f0", "i8"), Value(f"{name}.f1", "i8"), Value("1", "i8", True, 1)]
        else:
            parts = value.parts
        start, stop, step = parts
        last = (
            stop.code if is_word(stop.code) and stop.constant is not None else self.new("i8", bare(stop.code))
        )
        stride = step.code if step.constant is not None else self.new("i8", step.code)
        self.number += 1
        place = f"_{self.number}"
        if step.constant is None:
            test = f"{stride} > 0 ? {place} < {last} : {place} > {last}"
            natural = False
        elif step.constant > 0:
            test, natural = f"{place} < {last}", start.natural
        else:
            test, natural = f"{place} > {last}", stop.natural or stop.constant == -1
        onward = {"1": f"{place}++", "-1": f"{place}--"}.get(stride, f"{place} += {stride}")
        with self.block(f"for (int64_t {place} = {bare(start.code)}; {test}; {onward})"):
            self.assign(target, Value(place, "i8", natural))
            self.statements(body)

    def for_items(self, value: Value, target: Any, body: list[Any]) -> None:
        """A loop over the items of a tuple."""
        parts = [self.item(value, k) for k in range(len(value.type.items))]
        kept = [self.stored(part) for part in parts]
        place = self.new("i8")
        with self.block(f"for ({place} = 0; {place} < {len(kept)}; {place}++)"):
            if isinstance(target, ast.Name) or not all(part.parts for part in kept):
                with self.block(f"switch ({place})"):
                    for k, part in enumerate(kept):
                        self.put(f"case {k}:" if k < len(kept) - 1 else "default:")
                        self.depth += 1
                        self.assign(target, part)
                        self.put("break;")
                        self.depth -= 1
            else:
                choices = [[part.parts[m] for part in kept if part.parts] for m in range(len(target.elts))]
                for one, of in zip(target.elts, choices, strict=True):
                    self.assign(one, self.chosen(place, of))
            self.statements(body)

    def chosen(self, place: str, values: list[Value]) -> Value:
        """That of some values which has a number."""
        type_ = None
        for value in values:
            type_ = unified(type_, value.type)
        code = self.as_(values[-1], type_)
        for k in range(len(values) - 2, -1, -1):
            code = f"({place} == {k} ? {self.as_(values[k], type_)} : {code})"
        return Value(code, type_, all(value.natural for value in values))

    def stored(self, value: Value) -> Value:
        """A value that stays what it is, whatever happens: in names of its own, but for constants."""
        if value.parts is not None and value.type != RANGE:
            return replace(value, parts=[self.stored(part) for part in value.parts])
        if value.constant is not None:
            return value
        if isinstance(value.type, Arr):
            name = self.slot(value.type)
            self.hold(name, value)
            return Value(name, value.type)
        if has_arrays(value.type):
            raise Untranslated("a tuple of arrays among others")
        name = self.new(value.type, bare(value.code))
        return Value(name, value.type, value.natural)

    def hold(self, name: str, value: Value) -> None:
        """Have a name hold an array."""
        moved = value.cell is not None
        value = self.made(value, fresh=True)
        self.put(f"{'take' if value.fresh or moved else 'keep'}(&{name}, {value.code});")
        if moved:
            self.put(f"{value.code}.owner = NULL;")

    def on_Assign(self, node: Any) -> None:
        """Names and places given values."""
        target, source = node.targets[0], node.value
        if len(node.targets) == 1 and isinstance(target, ast.Tuple) and isinstance(source, ast.Tuple):
            if len(target.elts) == len(source.elts) and not any(
                isinstance(e, ast.Starred) for e in source.elts
            ):
                values = [self.value(one) for one in source.elts]
                names = {one.id for one in target.elts if isinstance(one, ast.Name)}
                simple = len(names) == len(target.elts) and not names & {
                    n.id for one in source.elts for n in ast.walk(one) if isinstance(n, ast.Name)
                }
                if not simple:
                    values = [self.stored(value) for value in values]
                self.check()
                for one, value in zip(target.elts, values, strict=True):
                    self.assign(one, value)
                self.check()
                return
        value = self.value(source)
        if len(node.targets) > 1:
            value = self.stored(value)
        self.check()
        for one in node.targets:
            self.assign(one, value)
        self.check()

    def on_AnnAssign(self, node: Any) -> None:
        """A name given a value, with a note of its type."""
        self.assign(node.target, self.value(node.value))
        self.check()

    def on_AugAssign(self, node: Any) -> None:
        """A name or a place changed."""
        target = node.target
        if isinstance(target, ast.Subscript):
            place = self.place(target)
            if isinstance(place.type, Arr):
                self.change_cells(place, node.op, self.value(node.value))
            else:
                value = self.operation(node.op, place, self.value(node.value))
                self.check()
                self.put(f"{place.code} = {self.as_(value, place.type)};")
            return
        here = self.value(ast.Name(target.id, ast.Load()))
        if isinstance(here.type, Arr):
            self.change_cells(here, node.op, self.value(node.value))
        else:
            self.assign(target, self.operation(node.op, here, self.value(node.value)))
        self.check()

    def change_cells(self, place: Value, op: Any, value: Value) -> None:
        """Change the cells of an array."""
        place = self.named_array(place)
        value = self.steady_cells(value)
        with self.cells(self.lengths(place)) as indices:
            here = self.element(place, [Value(i, "i8", True) for i in indices])
            changed = self.operation(op, here, self.cell_of(value, indices), whole=True)
            self.put(f"{here.code} = {self.as_(changed, place.type.kind)};")
        self.check()

    def assign(self, target: Any, value: Value) -> None:
        """Give a value to a name, a place, or several of them."""
        if isinstance(target, ast.Tuple):
            if isinstance(value.type, Arr):
                array = self.steady_cells(value) if value.cell else self.named_array(value)
                items = []
                for k in range(len(target.elts)):
                    one = Value(str(k), "i8", True, k)
                    cell = self.cell_of(array, [one.code]) if array.cell else self.element(array, [one])
                    items.append(self.stored(cell))
            else:
                if value.parts is None:
                    value = self.in_name(value)
                items = [self.item(value, k) for k in range(len(target.elts))]
                if value.parts is not None and len(items) > 1:
                    items = [self.stored(item) for item in items]
            for one, item in zip(target.elts, items, strict=True):
                self.assign(one, item)
        elif isinstance(target, ast.Name) and target.id != "_":
            self.assign_name(target.id, value)
        elif not isinstance(target, ast.Name):
            self.assign_place(target, value)

    def in_name(self, value: Value) -> Value:
        """A tuple in a name, which holds its arrays."""
        if is_word(value.code):
            return value
        if has_arrays(value.type):
            name = self.slot(value.type)
            self.replace_tuple(name, value)
            self.check()
        else:
            name = self.new(value.type, value.code)
        return Value(name, value.type)

    def replace_tuple(self, name: str, value: Value) -> None:
        """Have a name hold a tuple that a kernel gave."""
        given = self.new(value.type, value.code)
        for line in drops_of(name, value.type):
            self.put(line)
        self.put(f"{name} = {given};")

    def assign_name(self, name: str, value: Value) -> None:
        """Give a value to a name."""
        if value.type == NOTHING:
            raise Untranslated(f"{name} is nothing")
        self.types[name] = type_ = unified(self.types.get(name), value.type)
        self.natural[name] = self.natural.get(name, True) and value.natural
        if isinstance(type_, Arr):
            lent = (
                not value.fresh and value.cell is None and name not in self.arguments and self.is_lent(value)
            )
            self.borrowed[name] = self.borrowed.get(name, True) and lent
            if self.borrowed[name]:
                self.put(f"{safe(name)} = {value.code};")
            else:
                self.hold(safe(name), value)
        elif isinstance(type_, Tup) and has_arrays(type_):
            if value.parts is None:
                self.replace_tuple(safe(name), value)
            else:
                for k, item in enumerate(type_.items):
                    if isinstance(item, Arr):
                        self.hold(f"{safe(name)}.f{k}", value.parts[k])
                    elif has_arrays(item):
                        for path in arrays_of(value.parts[k].code, item):
                            self.put(f"Py_XINCREF({path}.owner);")
                        for line in drops_of(f"{safe(name)}.f{k}", item):
                            self.put(line)
                        self.put(f"{safe(name)}.f{k} = {value.parts[k].code};")
                    else:
                        self.put(f"{safe(name)}.f{k} = {self.as_(value.parts[k], item)};")
        elif type_ == RANGE and value.parts:
            self.put(f"{safe(name)} = (Range){{{value.parts[0].code}, {value.parts[1].code}}};")
        else:
            code = self.as_(value, type_)
            if code != safe(name):
                self.put(f"{safe(name)} = {bare(code)};")

    def is_lent(self, value: Value) -> bool:
        """True if the memory behind an array is held by a name that never lets go of it."""
        return bool(value.roots) and all(
            root in self.steady or self.borrowed.get(root, False) for root in value.roots
        )

    def assign_place(self, target: Any, value: Value) -> None:
        """Give a value to a cell, to several, or to those that others number."""
        place = self.place(target)
        if not isinstance(place.type, Arr):
            self.put(f"{place.code} = {self.as_(value, place.type)};")
            return
        if place.cell is not None:
            value = self.steady_cells(value)
            with self.cells(place.shape) as indices:
                here = place.cell(indices)
                self.put(f"{here.code} = {self.as_(self.cell_of(value, indices), here.type)};")
            return
        place = self.named_array(place)
        if isinstance(value.type, Tup):
            for k in range(len(value.type.items)):
                here = self.element(place, [Value(str(k), "i8", True, k)])
                self.put(f"{here.code} = {self.as_(self.item(value, k), here.type)};")
            return
        value = self.steady_cells(self.made(value) if value.cell else value)
        with self.cells(self.lengths(place)) as indices:
            here = self.element(place, [Value(i, "i8", True) for i in indices])
            self.put(f"{here.code} = {self.as_(self.cell_of(value, indices), here.type)};")

    # Arrays

    @contextmanager
    def cells(self, lengths: list[str]) -> Any:
        """Loops over all cells."""
        indices = []
        for length in lengths:
            self.number += 1
            indices.append(f"_{self.number}")
            self.put(f"for (int64_t {indices[-1]} = 0; {indices[-1]} < {length}; {indices[-1]}++) {{")
            self.depth += 1
        yield indices
        for _ in lengths:
            self.depth -= 1
            self.put("}")

    def lengths(self, array: Value) -> list[str]:
        """The lengths of the axes of an array in a name."""
        return [f"{array.code}.n{k}" for k in range(array.type.axes)]

    def named_array(self, value: Value) -> Value:
        """An array whose code is a name."""
        value = self.made(value)
        if is_word(value.code):
            return value
        if value.fresh:
            name = self.slot(value.type)
            self.hold(name, value)
            self.check()
        else:
            name = self.new(value.type, value.code)
        return with_roots(Value(name, value.type), value)

    def made(self, value: Value, fresh: bool = False) -> Value:
        """An array in memory, in a name that holds it or, if `fresh`, of no holder yet."""
        if value.cell is None:
            if value.fresh and not fresh:
                return self.in_slot(value)
            return value
        lengths = [self.new("i8", length) if not is_word(length) else length for length in value.shape]
        axes = value.type.axes
        made = self.slot(value.type)
        sizes = ", ".join([*lengths, "0", "0"][:3])
        self.put(f"take(&{made}, shaped({SIZES[value.type.kind]}, {axes}, {sizes}, {self.may_fail()}));")
        self.check()
        array = Value(made, value.type)
        with self.cells(lengths) as indices:
            here = self.element(array, [Value(i, "i8", True) for i in indices])
            self.put(f"{here.code} = {self.as_(self.cell_of(value, indices), value.type.kind)};")
        return array

    def in_slot(self, value: Value) -> Value:
        """A fresh array in a name that holds it."""
        name = self.slot(value.type)
        self.put(f"take(&{name}, {value.code});")
        self.check()
        return Value(name, value.type)

    def steady_cells(self, value: Value) -> Value:
        """What gives a cell in a loop: a scalar in a name, an array in one, or what computes cells."""
        if value.cell is not None or value.constant is not None:
            return value
        if isinstance(value.type, Arr):
            return self.named_array(value)
        return (
            replace(value, code=self.new(value.type, bare(value.code))) if not is_word(value.code) else value
        )

    def cell_of(self, value: Value, indices: list[str]) -> Value:
        """The cell of an array, or a number itself, where a loop over cells is."""
        if value.cell is not None:
            own = indices[len(indices) - len(value.shape) :]
            return value.cell(
                ["0" if length == "1" else i for i, length in zip(own, value.shape, strict=True)]
            )
        if isinstance(value.type, Arr):
            own = indices[len(indices) - value.type.axes :]
            return self.element(value, [Value(i, "i8", True) for i in own])
        return value

    def element(self, array: Value, indices: list[Value]) -> Value:
        """A cell of an array in a name, or the rest of its axes where fewer are numbered."""
        type_, name = array.type, array.code
        if any(i.type not in C_OF or i.type in ("f8", "f4") for i in indices):
            raise Untranslated("an index that is no whole number")
        codes = [
            i.code if i.natural else f"wrap({bare(i.code)}, {name}.n{k})" if i.constant is None
            else f"({name}.n{k} - {-i.constant})" for k, i in enumerate(indices)
        ]  # fmt: skip
        if len(indices) < type_.axes:
            code = name
            for one in codes:
                code = f"at({code}, 0, {bare(one)})"
            return with_roots(Value(code, replace(type_, axes=type_.axes - len(indices))), array)
        c_type = C_OF[type_.kind] if type_.aligned or SIZES[type_.kind] == 1 else f"{type_.kind}u"
        if type_.rows:
            code = codes[0]
            for k, one in enumerate(codes[1:], 1):
                code = f"{code if k == 1 else f'({code})'} * {name}.n{k} + {one}"
            return Value(f"(({c_type} *){name}.p)[{bare(code)}]", type_.kind, type_.kind[0] in "ub")
        steps = " + ".join(f"{one} * {name}.s{k}" for k, one in enumerate(codes))
        return Value(f"*({c_type} *)({name}.p + {steps})", type_.kind, type_.kind[0] in "ub")

    def place(self, node: Any) -> Value:
        """What a subscript names."""
        return self.on_subscript(self.value(node.value), node.slice)

    def on_subscript(self, array: Value, index: Any) -> Value:
        """A part of an array or a tuple."""
        if isinstance(array.type, Tup):
            if isinstance(index, ast.Slice):
                start, stop = (
                    None if e is None else self.value(e).constant for e in (index.lower, index.upper)
                )
                parts = [self.item(array, k) for k in range(len(array.type.items))][start:stop]
                return tuple_of(parts)
            return self.item(array, self.value(index).constant)
        items = index.elts if isinstance(index, ast.Tuple) else [index]
        if array.cell is not None or array.fresh:
            array = self.made(array)
        values: list[Any] = []
        for item in items:
            if isinstance(item, ast.Slice):
                values.append(item)
                continue
            value = self.value(item)
            if isinstance(value.type, Tup):
                values += [self.item(value, k) for k in range(len(value.type.items))]
            else:
                values.append(value)
        if isinstance(values[0], Value) and isinstance(values[0].type, Arr):
            return self.numbered(array, values)
        if not any(isinstance(value, ast.Slice) for value in values):
            array = array if is_word(array.code) else self.named_array(array)
            return self.element(array, values)
        return self.slice(array, values)

    def slice(self, array: Value, values: list[Any]) -> Value:
        """A view of an array."""
        type_, code, axis = array.type, array.code, 0
        rows = type_.rows
        for value in values:
            if isinstance(value, Value):
                name = code if is_word(code) else None
                n = f"{name}.n{axis}" if name else ""
                if not value.natural and name is None:
                    code = name = self.new(replace(type_), code)
                    n = f"{name}.n{axis}"
                at = value.code if value.natural else f"wrap({bare(value.code)}, {n})"
                code = f"at({code}, {axis}, {bare(at)})"
                rows = rows and axis == 0
                type_ = replace(type_, axes=type_.axes - 1)
                continue
            if value.step is not None:
                if self.value(value.step).constant != -1 or value.lower or value.upper or axis:
                    raise Untranslated("a slice in steps")
                code, rows = f"reversed({code})", False
            elif value.lower is not None or value.upper is not None:
                lower = self.value(value.lower).code if value.lower else "0"
                upper = self.value(value.upper).code if value.upper else "INT64_MAX"
                code = f"cut({code}, {axis}, {bare(lower)}, {bare(upper)})"
                rows = rows and axis == 0
            axis += 1
        return with_roots(Value(code, replace(type_, rows=rows)), array)

    def numbered(self, array: Value, values: list[Any]) -> Value:
        """The cells or rows of an array that another numbers, or marks."""
        index, rest = values[0], values[1:]
        if rest:
            raise Untranslated("numbers of cells beside other indices")
        array = array if is_word(array.code) else self.named_array(array)
        if index.type.kind == "b1":
            index = self.true_places(index)
        index = self.steady_cells(index)
        length = index.shape[0] if index.cell else f"{index.code}.n0"

        def cell(indices: list[str]) -> Value:
            places = [self.cell_of(index, indices[:1]), *(Value(i, "i8", True) for i in indices[1:])]
            return self.element(array, places)

        shape = [length, *self.lengths(array)[1:]]
        return Value("", Arr(array.type.kind, array.type.axes), cell=cell, shape=shape)

    def true_places(self, mask: Value) -> Value:
        """The numbers of the cells of a mask that are true."""
        mask = self.steady_cells(mask)
        length = mask.shape[0] if mask.cell else f"{mask.code}.n0"
        count = self.new("i8", "0")
        found = self.slot(Arr("i8", 1))
        with self.cells([length]) as indices:
            self.put(f"{count} += {self.cell_of(mask, indices).code};")
        self.put(f"take(&{found}, shaped(8, 1, {count}, 0, 0, {self.may_fail()}));")
        self.check()
        self.put(f"{count} = 0;")
        with self.cells([length]) as indices:
            self.put(
                f"if ({self.cell_of(mask, indices).code}) ((int64_t *){found}.p)[{count}++] = {indices[0]};"
            )
        return Value(found, Arr("i8", 1))

    # Expressions

    def value(self, node: Any) -> Value:
        """An expression."""
        translated = getattr(self, f"of_{type(node).__name__}", None)
        if translated is None:
            raise Untranslated(ast.unparse(node))
        return translated(node)

    def of_Constant(self, node: Any) -> Value:
        """A number."""
        return self.constant(node.value)

    def constant(self, value: Any) -> Value:
        """A number, a tuple or an array that is known."""
        if isinstance(value, np.generic):
            kind = value.dtype.str[1:]
            return replace(self.constant(value.item()), type=kind)
        if isinstance(value, bool):
            return Value(str(int(value)), "b1", True, value)
        if isinstance(value, int):
            kind = "u8" if value >= 2**63 else "i8"
            code = literal(value, kind)
            return Value(f"({code})" if value < 0 else code, kind, value >= 0, value)
        if isinstance(value, float):
            code = literal(value, "f8")
            return Value(f"({code})" if code[0] == "-" else code, "f8", False, value)
        if isinstance(value, tuple):
            return tuple_of([self.constant(one) for one in value])
        if isinstance(value, np.ndarray):
            return self.whole.table(np.ascontiguousarray(value))
        raise Untranslated(f"the constant {value!r}")

    def of_Name(self, node: Any) -> Value:
        """What a name stands for."""
        if node.id in self.types:
            value = Value(safe(node.id), self.types[node.id], self.natural.get(node.id, False))
            return with_roots(value, value, [node.id])
        if node.id not in self.globals:
            raise Untranslated(f"the name {node.id}")
        return self.constant(self.globals[node.id])

    def of_Attribute(self, node: Any) -> Value:
        """The shape of an array, a field of a tuple, a constant of numpy."""
        if isinstance(node.value, ast.Name) and node.value.id == "np":
            return self.constant(getattr(np, node.attr))
        value = self.value(node.value)
        if isinstance(value.type, Tup):
            return self.item(value, value.type.names.index(node.attr))
        if node.attr == "shape":
            array = self.measured(value)
            return tuple_of([Value(length, "i8", True) for length in self.lengths(array)])
        if node.attr == "size":
            array = self.measured(value)
            return Value("(" + " * ".join(self.lengths(array)) + ")", "i8", True)
        raise Untranslated(f"the attribute {node.attr}")

    def measured(self, value: Value) -> Value:
        """An array whose lengths can be asked for."""
        return value if value.cell is None and is_word(value.code) else self.named_array(value)

    def item(self, value: Value, k: int) -> Value:
        """An item of a tuple."""
        if value.parts is not None:
            return value.parts[k]
        part = Value(f"{value.code}.f{k}", value.type.items[k])
        return with_roots(part, value)

    def of_Tuple(self, node: Any) -> Value:
        """A tuple."""
        return tuple_of([self.value(one) for one in node.elts])

    def of_Subscript(self, node: Any) -> Value:
        """A part of an array or a tuple."""
        return self.place(node)

    def of_UnaryOp(self, node: Any) -> Value:
        """Minus, not, and the bits turned."""
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return Value(f"(!{self.truth(value)})", "b1", True)
        if isinstance(node.op, ast.USub):
            if value.constant is not None:
                return self.constant(-value.constant)
            return self.cellwise(
                [value], lambda a: Value(f"(-{a.code})", "i8" if a.type[0] in "iub" else a.type)
            )
        if isinstance(node.op, ast.Invert):
            return self.cellwise(
                [value], lambda a: Value(f"(!{a.code})" if a.type == "b1" else f"(~{a.code})", a.type)
            )
        raise Untranslated(ast.dump(node.op))

    def of_BinOp(self, node: Any) -> Value:
        """Arithmetic."""
        return self.operation(node.op, self.value(node.left), self.value(node.right))

    def operation(self, op: Any, left: Value, right: Value, whole: bool = False) -> Value:
        """Arithmetic on numbers, or cell by cell."""
        if isinstance(left.type, Arr) or isinstance(right.type, Arr):
            return self.cellwise([left, right], lambda a, b: self.arithmetic(op, a, b, True))
        return self.arithmetic(op, left, right, whole)

    def arithmetic(self, op: Any, a: Value, b: Value, whole: bool = False) -> Value:
        """Arithmetic on numbers; division is unchecked on the cells of whole arrays."""
        sign = OPERATORS[type(op)]
        if isinstance(a.type, Tup) or isinstance(b.type, Tup):
            raise Untranslated("arithmetic with tuples")
        if a.constant is not None and b.constant is not None and "u8" not in (a.type, b.type):
            folded = {"+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y,
                      "<<": lambda x, y: x << y, "**": lambda x, y: x * x if y == 2 else x**y}.get(sign)  # fmt: skip
            if folded and isinstance(a.constant, int) and isinstance(b.constant, int):
                return self.constant(folded(a.constant, b.constant))
        if sign == "/":
            kind = "f4" if a.type == b.type == "f4" else "f8"
            x, y = self.as_(a, kind), self.as_(b, kind)
            if whole or b.constant:
                return Value(f"({x} / {y})", kind)
            self.risk = self.can_fail = True
            return Value(f"quotient{'f' if kind == 'f4' else ''}({bare(x)}, {bare(y)}, &bad)", kind)
        if sign == "**":
            if not isinstance(b.constant, int) or b.constant not in (2, 4, 8):
                raise Untranslated(f"the power {b.constant}")
            if a.type not in ("f8", "i8"):
                raise Untranslated(f"a power of {a.type}")
            code, name = bare(a.code), "square" if a.type == "f8" else "square_i8"
            for _ in range({2: 1, 4: 2, 8: 3}[b.constant]):
                code = f"{name}({code})"
            return Value(code, a.type, a.type == "i8")
        kind = self.kind_of(a.type, b.type)
        if sign in ("&", "|", "^") and a.type == b.type == "b1":
            return Value(f"({a.code} {sign} {b.code})", "b1", True)
        if sign in ("&", "|", "^", "<<", ">>", "//", "%") and kind in ("f8", "f4"):
            raise Untranslated(f"{sign} of floats")
        x, y = self.as_(a, kind), self.as_(b, kind)
        natural = a.natural and b.natural
        if sign in ("//", "%"):
            return self.whole_division(sign, Value(x, kind, a.natural), replace(b, code=y))
        if sign == "&":
            natural = a.natural or b.natural
        if sign in (">>", "<<"):
            natural = a.natural
        return Value(f"({x} {sign} {y})", kind, natural and sign != "-" and kind == "i8")

    def whole_division(self, sign: str, a: Value, b: Value) -> Value:
        """Division of whole numbers, down."""
        over = "/" if sign == "//" else "%"
        natural = b.natural if sign == "%" else a.natural and b.natural
        if isinstance(b.constant, int) and b.constant > 0:
            if b.constant & (b.constant - 1) == 0:
                code = (
                    f"({a.code} >> {b.constant.bit_length() - 1})"
                    if sign == "//"
                    else f"({a.code} & {b.constant - 1})"
                )
            elif a.natural:
                code = f"({a.code} {over} {b.code})"
            else:
                code = f"{'floored' if sign == '//' else 'modulo'}({bare(a.code)}, {b.code})"
            return Value(code, "i8", natural)
        self.risk = self.can_fail = True
        name = "floored_checked" if sign == "//" else "modulo_checked"
        return Value(f"{name}({bare(a.code)}, {bare(b.code)}, &bad)", "i8", natural)

    def kind_of(self, one: str, other: str) -> str:
        """The kind of a number made of two."""
        pair = {one, other}
        if "u8" in pair:
            if len(pair) > 1:
                raise Untranslated(f"{one} with {other}")
            return "u8"
        if pair == {"f4"}:
            return "f4"
        if pair & {"f8", "f4"}:
            return "f4" if pair <= {"f4", "u1", "u2", "b1"} else "f8"
        return "i8"

    def cellwise(self, values: list[Value], function: Callable[..., Value]) -> Value:
        """A function of numbers, or of the cells of arrays."""
        if not any(isinstance(value.type, Arr) for value in values):
            return function(*values)
        steady = [self.steady_cells(value) for value in values]
        shapes = [v.shape if v.cell else self.lengths(v) if isinstance(v.type, Arr) else [] for v in steady]
        axes = max(map(len, shapes))
        shape = []
        for k in range(axes):
            lengths = [s[k - axes + len(s)] for s in shapes if k - axes + len(s) >= 0]
            shape.append(next((length for length in lengths if length != "1"), "1"))

        def cell(indices: list[str]) -> Value:
            return function(*(self.cell_of(value, indices) for value in steady))

        sample = cell(["0"] * axes)
        return Value("", Arr(sample.type, axes), cell=cell, shape=shape)

    def of_Compare(self, node: Any) -> Value:
        """Comparisons, one after the other."""
        values = [self.value(one) for one in (node.left, *node.comparators)]
        if len(values) > 2:
            values[1:-1] = [
                v if is_simple(v.code) else replace(v, code=self.new(v.type, bare(v.code)))
                for v in values[1:-1]
            ]
        results = [
            self.cellwise([a, b], lambda a, b, op=op: self.compared(op, a, b))
            for op, a, b in zip(node.ops, values, values[1:], strict=False)
        ]
        if len(results) == 1:
            return results[0]
        return Value("(" + " && ".join(result.code for result in results) + ")", "b1", True)

    def compared(self, op: Any, a: Value, b: Value) -> Value:
        """A comparison of two numbers."""
        kind = a.type if a.type == b.type else self.kind_of(a.type, b.type)
        if isinstance(kind, Tup):
            raise Untranslated("a comparison of tuples")
        x, y = self.as_(a, kind), self.as_(b, kind)
        return Value(f"({x} {COMPARISONS[type(op)]} {y})", "b1", True)

    def of_BoolOp(self, node: Any) -> Value:
        """And, or."""
        sign = "&&" if isinstance(node.op, ast.And) else "||"
        code = self.truth(self.value(node.values[0]))
        result = None
        for one in node.values[1:]:
            lines, risk = self.lines, self.risk
            self.lines, self.risk = [], False
            self.depth += 1
            right = self.truth(self.value(one))
            self.depth -= 1
            inner, self.lines = self.lines, lines
            if not inner:
                code, self.risk = f"{code} {sign} {right}", self.risk or risk
                continue
            self.risk = risk or self.risk
            if result is None:
                result = self.new("b1", bare(code))
            else:
                self.put(f"{result} = {bare(code)};")
            self.put(f"if ({'' if sign == '&&' else '!'}{result}) {{")
            self.lines += inner
            self.put(f"    {result} = {bare(right)};")
            self.put("}")
            code = result
        return Value(f"({code})", "b1", True)

    def of_IfExp(self, node: Any) -> Value:
        """One of two values."""
        test = self.truth(self.value(node.test))
        branches, inner = [], []
        for one in (node.body, node.orelse):
            lines, self.lines = self.lines, []
            self.depth += 1
            branches.append(self.value(one))
            self.depth -= 1
            inner.append(self.lines)
            self.lines = lines
        a, b = branches
        if isinstance(a.type, Tup):
            if a.parts is None or b.parts is None or inner != [[], []]:
                raise Untranslated("a choice of tuples")
            name = test if is_simple(test) else self.new("b1", bare(test))
            return tuple_of([self.choice(name, x, y) for x, y in zip(a.parts, b.parts, strict=True)])
        if inner == [[], []]:
            return self.choice(test, a, b)
        type_ = unified(a.type, b.type)
        name = self.new(type_)
        self.put(f"if ({bare(test)}) {{")
        for lines, value in zip(inner, branches, strict=True):
            self.lines += lines
            self.put(f"    {name} = {self.as_(value, type_)};")
            self.put("} else {" if value is a else "}")
        return Value(name, type_, a.natural and b.natural)

    def choice(self, test: str, a: Value, b: Value) -> Value:
        """One of two values, without lines before."""
        if a.fresh or b.fresh or a.cell or b.cell:
            raise Untranslated("a choice of new arrays")
        type_ = unified(a.type, b.type)
        if isinstance(type_, Tup):
            return tuple_of(
                [self.choice(test, self.item(a, k), self.item(b, k)) for k in range(len(type_.items))]
            )
        code = f"({test} ? {self.as_(a, type_)} : {self.as_(b, type_)})"
        value = Value(code, type_, a.natural and b.natural)
        return with_roots(value, value, [*a.roots, *b.roots])

    def truth(self, value: Value) -> str:
        """An expression as a condition."""
        if not isinstance(value.type, str):
            raise Untranslated("the truth of an array")
        return value.code if value.type in ("b1", "i8", "i4", "u1") else f"({value.code} != 0)"

    def as_(self, value: Value, type_: Any) -> str:
        """An expression converted to a type."""
        if value.type == type_:
            if isinstance(type_, Tup) and value.parts is not None:
                inner = ", ".join(
                    self.as_(part, item) for part, item in zip(value.parts, type_.items, strict=True)
                )
                return f"({self.whole.c_type(type_)}){{{inner}}}"
            return value.code
        if isinstance(type_, Arr) and isinstance(value.type, Arr):
            return value.code
        if isinstance(type_, Tup):
            parts = [self.item(value, k) for k in range(len(type_.items))]
            inner = ", ".join(self.as_(part, item) for part, item in zip(parts, type_.items, strict=True))
            return f"({self.whole.c_type(type_)}){{{inner}}}"
        if not isinstance(value.type, str) or not isinstance(type_, str):
            raise Untranslated(f"{value.type} as {type_}")
        if type_ == "b1":
            return f"({value.code} != 0)"
        if value.constant is not None and type_ in ("f8", "f4") and not isinstance(value.constant, float):
            return (
                f"{literal(value.constant, type_)}"
                if value.constant >= 0
                else f"({literal(value.constant, type_)})"
            )
        if type_ == "i8" and value.type in ("b1", "u1", "u2", "i4") and value.constant is not None:
            return value.code
        return f"({C_OF[type_]}){value.code}"

    # Calls

    def of_Call(self, node: Any) -> Value:
        """A call of a kernel, of Python's functions, of numpy's, or of an array's."""
        function = node.func
        if isinstance(function, ast.Attribute):
            if isinstance(function.value, ast.Name) and function.value.id == "np":
                return self.of_numpy(function.attr, node)
            return self.of_method(function.attr, self.value(function.value), node.args)
        if isinstance(self.globals.get(function.id), Kernel):
            return self.of_kernel(self.globals[function.id], node.args)
        return getattr(self, f"call_{function.id}")(*[self.value(one) for one in node.args])

    def of_kernel(self, kernel: Any, nodes: list[Any]) -> Value:
        """A call of a kernel."""
        values: list[Value] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                whole = self.value(node.value)
                values += [self.item(whole, k) for k in range(len(whole.type.items))]
            else:
                values.append(self.value(node))
        values = [self.made(value) if isinstance(value.type, Arr) else value for value in values]
        called = self.whole.function(kernel, tuple(value.type for value in values))
        if called not in self.calls:
            self.calls.append(called)
        words = [bare(self.as_(value, value.type)) for value in values]
        if called.can_fail:
            words.append("&raised")
            self.risk = self.can_fail = True
        return Value(
            f"{called.name}({', '.join(words)})", called.returns, fresh=isinstance(called.returns, Arr)
        )

    def of_method(self, name: str, array: Value, nodes: list[Any]) -> Value:
        """A method of an array."""
        if name in ("sum", "any", "max", "min", "argmin", "argmax"):
            return self.reduced(name, array)
        if name == "copy":
            array = self.steady_cells(array)
            return Value("", Arr(array.type.kind, array.type.axes), cell=lambda i: self.cell_of(array, i),
                         shape=array.shape if array.cell else self.lengths(array))  # fmt: skip
        if name == "ravel":
            array = self.named_array(array)
            if not array.type.rows:
                raise Untranslated("ravel of a view")
            raveled = Value(f"raveled({array.code}, {array.type.axes})", Arr(array.type.kind, 1))
            return with_roots(raveled, array)
        if name == "reshape":
            array = self.named_array(array)
            return Value("", Arr(array.type.kind, 2), cell=lambda i: self.cell_of(array, i[:1]),
                         shape=[f"{array.code}.n0", "1"])  # fmt: skip
        if name == "astype":
            kind = self.kind(nodes[0])
            return self.cellwise([array], lambda a: Value(f"({C_OF[kind]}){a.code}", kind))
        raise Untranslated(f"the method {name}")

    def reduced(self, name: str, array: Value) -> Value:
        """One number of all cells."""
        array = self.steady_cells(array)
        kind, lengths = array.type.kind, array.shape if array.cell else self.lengths(array)
        if name in ("sum", "count_nonzero", "any", "all"):
            if kind != "b1":
                raise Untranslated(f"{name} of {kind}")
            total = self.new("i8", "1" if name == "all" else "0")
            with self.cells(lengths) as indices:
                one = self.cell_of(array, indices).code
                self.put(
                    {"any": f"{total} |= {one};", "all": f"{total} &= {one};"}.get(name, f"{total} += {one};")
                )
            return Value(total, "b1" if name in ("any", "all") else "i8", True)
        size = " * ".join(lengths)
        self.put(f"if (({size}) == 0) bad = EMPTY;")
        self.may_fail()
        self.check()
        best, place, first = self.new(kind, "0"), self.new("i8", "0"), self.new("i8", "0")
        sign = "<" if "min" in name else ">"
        with self.cells(lengths) as indices:
            one = self.new(kind, self.cell_of(array, indices).code)
            odd = f" || ({one} != {one} && {best} == {best})" if kind in ("f8", "f4") else ""
            self.put(f"if ({first} == 0 || {one} {sign} {best}{odd}) {best} = {one}, {place} = {first};")
            self.put(f"{first}++;")
        return Value(place, "i8", True) if name.startswith("arg") else Value(best, kind, kind[0] in "ub")

    def call_range(self, *values: Value) -> Value:
        """Whole numbers in a row."""
        start, stop, step = self.constant(0), values[0], self.constant(1)
        if len(values) > 1:
            start, stop = values[:2]
        if len(values) == 3:
            step = values[2]
        start, stop = (replace(v, code=self.as_(v, "i8"), type="i8") for v in (start, stop))
        return Value("", RANGE, parts=[start, stop, step])

    def call_len(self, value: Value) -> Value:
        """How many there are."""
        if value.type == RANGE:
            return Value(f"max_i8({value.code}.f1 - {value.code}.f0, 0)", "i8", True)
        if isinstance(value.type, Tup):
            return self.constant(len(value.type.items))
        if value.cell is not None:
            return Value(value.shape[0], "i8", True)
        return Value(f"{self.measured(value).code}.n0", "i8", True)

    def call_abs(self, value: Value) -> Value:
        """Without the sign."""
        if value.type in ("f8", "f4"):
            return Value(f"fabs{'f' if value.type == 'f4' else ''}({bare(value.code)})", value.type)
        return Value(f"abs_i8({bare(value.code)})", "i8", True)

    def call_int(self, value: Value) -> Value:
        """Towards zero."""
        if value.type == "i8":
            return value
        return Value(f"(int64_t){value.code}", "i8", value.natural)

    def call_float(self, value: Value) -> Value:
        """As a double."""
        return value if value.type == "f8" else Value(self.as_(replace(value, constant=None), "f8"), "f8")

    def call_bool(self, value: Value) -> Value:
        """As a truth."""
        return Value(self.truth(value), "b1", True)

    def call_min(self, *values: Value) -> Value:
        """The least; of equals the first."""
        return self.extreme("min", values)

    def call_max(self, *values: Value) -> Value:
        """The largest; of equals the first."""
        return self.extreme("max", values)

    def extreme(self, name: str, values: tuple[Value, ...]) -> Value:
        """The least or the largest."""
        best = values[0]
        for value in values[1:]:
            type_ = unified(best.type, value.type)
            kind = type_ if type_ in ("f8", "f4") else "i8"
            natural = (best.natural or value.natural) if name == "max" else (best.natural and value.natural)
            code = f"{name}_{kind}({bare(self.as_(best, kind))}, {bare(self.as_(value, kind))})"
            best = Value(
                code, kind if kind[0] == "f" else type_ if type_ == "i4" else kind, natural and kind == "i8"
            )
        return best

    def kind(self, node: Any) -> str:
        """The kind of numbers that a type of numpy names."""
        if isinstance(node, ast.Attribute):
            return DTYPES[getattr(np, node.attr)]
        return DTYPES[{"float": float, "int": int, "bool": bool}[node.id]]

    def of_numpy(self, name: str, node: Any) -> Value:
        """A call of a function of numpy."""
        words = {one.arg: one.value for one in node.keywords}
        nodes = node.args
        if name in ("zeros", "empty", "full", "ones"):
            return self.allocated(name, nodes, words)
        if name in ("empty_like", "zeros_like"):
            like = self.measured(self.value(nodes[0]))
            shape = tuple_of([Value(length, "i8", True) for length in self.lengths(like)])
            return self.room("zeroed" if name == "zeros_like" else "shaped", like.type.kind, shape)
        if name in ("int64", "uint64", "float32", "float64"):
            value = self.value(nodes[0])
            kind = DTYPES[getattr(np, name)]
            if value.constant is not None and kind == "u8":
                return Value(literal(value.constant, "u8"), "u8", True, value.constant)
            return Value(f"({C_OF[kind]}){value.code}", kind, value.natural and kind == "i8")
        if name in ("argsort", "searchsorted"):
            return getattr(self, f"np_{name}")(nodes, words)
        values = [self.value(one) for one in nodes]
        if name in OF_FLOATS:
            if name in ("minimum", "maximum") and not any(v.type in ("f8", "f4") or isinstance(v.type, Arr)
                                                          and v.type.kind in ("f8", "f4") for v in values):  # fmt: skip
                return self.cellwise(values, lambda a, b: self.extreme(name[:3], (a, b)))
            return self.cellwise(values, lambda *cells: self.of_floats(name, cells))
        if name in ("isnan", "isfinite"):
            macro = name
            return self.cellwise(values, lambda a: Value(f"({macro}({a.code}) != 0)", "b1", True))
        if name in ("sum", "any", "all", "max", "min", "argmin", "argmax", "count_nonzero"):
            return self.reduced(name, values[0])
        return getattr(self, f"np_{name}")(*values)

    def of_floats(self, name: str, cells: tuple[Value, ...]) -> Value:
        """A function of doubles."""
        if any(cell.type == "f4" for cell in cells):
            raise Untranslated(f"{name} of float32")
        return Value(f"{OF_FLOATS[name]}({', '.join(bare(self.as_(cell, 'f8')) for cell in cells)})", "f8")

    def allocated(self, name: str, nodes: list[Any], words: dict[str, Any]) -> Value:
        """A new array of a shape."""
        shape = self.value(nodes[0])
        rest = nodes[1:]
        fill = None
        if name == "full":
            fill, rest = self.value(nodes[1]), nodes[2:]
        elif name == "ones":
            fill = self.constant(1)
        kind = self.kind(rest[0] if rest else words["dtype"]) if rest or "dtype" in words else None
        kind = kind or (fill.type if name == "full" and fill else "f8")
        if fill is None:
            return self.room("zeroed" if name == "zeros" else "shaped", kind, shape)
        lengths = (
            [self.item(shape, k) for k in range(len(shape.type.items))]
            if isinstance(shape.type, Tup)
            else [shape]
        )
        fill = self.steady_cells(fill)
        stored = [self.as_(one, "i8") for one in lengths]
        one = Value(self.as_(fill, kind), kind, constant=None)
        return Value("", Arr(kind, len(stored)), cell=lambda indices: one, shape=stored)

    def room(self, function: str, kind: str, shape: Value) -> Value:
        """Room for an array."""
        lengths = (
            [self.item(shape, k) for k in range(len(shape.type.items))]
            if isinstance(shape.type, Tup)
            else [shape]
        )
        codes = [bare(self.as_(one, "i8")) for one in lengths]
        words = ", ".join([*codes, "0", "0"][:3])
        code = f"{function}({SIZES[kind]}, {len(codes)}, {words}, {self.may_fail()})"
        return Value(code, Arr(kind, len(codes)), fresh=True)

    def np_arange(self, count: Value) -> Value:
        """Whole numbers in a row."""
        return Value(
            "", Arr("i8", 1), cell=lambda i: Value(i[0], "i8", True), shape=[bare(self.as_(count, "i8"))]
        )

    def np_argsort(self, nodes: list[Any], words: dict[str, Any]) -> Value:
        """The order of doubles."""
        keys = self.made(self.value(nodes[0]))
        if keys.type.kind != "f8":
            raise Untranslated(f"the order of {keys.type.kind}")
        stable = int("kind" in words)
        return Value(f"argsorted({keys.code}, {stable}, {self.may_fail()})", Arr("i8", 1), fresh=True)

    def np_searchsorted(self, nodes: list[Any], words: dict[str, Any]) -> Value:
        """Where a number would be, or where each of some would be."""
        array = self.named_array(self.value(nodes[0]))
        kind, right = array.type.kind, int("side" in words)

        def where(value: Value) -> Value:
            return Value(f"searched_{kind}({array.code}, {bare(self.as_(value, kind))}, {right})", "i8", True)

        return self.cellwise([self.value(nodes[1])], where)

    def copied(self, value: Value) -> str:
        """The name of a copy of an array."""
        return self.made(self.of_method("copy", value, [])).code

    def np_sort(self, value: Value) -> Value:
        """A sorted copy."""
        copy = self.copied(value)
        self.put(f"quick_{value.type.kind}(NULL, 0, (void *){copy}.p, {copy}.n0);")
        return Value(copy, Arr(value.type.kind, 1))

    def np_unique(self, value: Value) -> Value:
        """The distinct values, ascending."""
        copy = self.copied(value)
        self.put(f"make_distinct(&{copy});")
        return Value(copy, Arr("i8", 1))

    def np_median(self, value: Value) -> Value:
        """The middle value."""
        return Value(f"median_of({self.copied(value)})", "f8")

    def np_flatnonzero(self, value: Value) -> Value:
        """The numbers of the cells that are true."""
        return self.true_places(value)

    def np_cumsum(self, value: Value) -> Value:
        """Running sums."""
        value = self.steady_cells(value)
        total = self.new("i8", "0")
        running = Value(total, "i8")

        def cell(indices: list[str]) -> Value:
            return replace(running, code=f"({total} += {self.cell_of(value, indices).code})")

        return self.made(
            Value("", Arr("i8", 1), cell=cell, shape=value.shape if value.cell else [f"{value.code}.n0"])
        )

    def np_where(self, test: Value, a: Value, b: Value) -> Value:
        """Cells of one or of another."""
        return self.cellwise([test, a, b], lambda t, x, y: self.choice(t.code, x, y))

    def np_radians(self, value: Value) -> Value:
        """Degrees in radians."""
        return Value(f"({self.as_(value, 'f8')} * {math.pi / 180!r})", "f8")

    def np_array(self, value: Value) -> Value:
        """An array of some numbers."""
        type_ = None
        for part in value.parts or []:
            type_ = unified(type_, part.type)
        stored = [self.stored(part) for part in value.parts or []]
        made = self.slot(Arr(type_, 1))
        self.put(f"take(&{made}, shaped({SIZES[type_]}, 1, {len(stored)}, 0, 0, {self.may_fail()}));")
        self.check()
        for k, one in enumerate(stored):
            self.put(f"(({C_OF[type_]} *){made}.p)[{k}] = {self.as_(one, type_)};")
        return Value(made, Arr(type_, 1))

    of_List = of_Tuple

    def np_append(self, a: Value, b: Value) -> Value:
        """One row behind another."""
        return self.joined(tuple_of([a, b]), 0)

    def np_vstack(self, value: Value) -> Value:
        """Tables one below the other."""
        return self.joined(value, 0)

    def np_hstack(self, value: Value) -> Value:
        """Tables side by side."""
        return self.joined(value, 1)

    def joined(self, value: Value, axis: int) -> Value:
        """Arrays joined along an axis."""
        parts = [self.steady_cells(part) for part in value.parts or []]
        shapes = [part.shape if part.cell else self.lengths(part) for part in parts]
        type_ = parts[0].type
        lengths = [" + ".join(s[k] for s in shapes) if k == axis else shapes[0][k] for k in range(type_.axes)]
        made = self.slot(Arr(type_.kind, type_.axes))
        sizes = ", ".join([*lengths, "0", "0"][:3])
        self.put(f"take(&{made}, shaped({SIZES[type_.kind]}, {type_.axes}, {sizes}, {self.may_fail()}));")
        self.check()
        array, before = Value(made, Arr(type_.kind, type_.axes)), "0"
        for part, shape in zip(parts, shapes, strict=True):
            with self.cells(shape) as indices:
                places = [
                    Value(f"({before} + {i})" if k == axis else i, "i8", True) for k, i in enumerate(indices)
                ]
                here = self.element(array, places)
                self.put(f"{here.code} = {self.as_(self.cell_of(part, indices), type_.kind)};")
            before = f"{before} + {shape[axis]}"
        return array


def with_roots(value: Value, of: Value, roots: list[str] | None = None) -> Value:
    """A value with the names that hold the memory behind another."""
    value.roots = of.roots if roots is None else roots
    return value


def tuple_of(parts: list[Value]) -> Value:
    """A tuple of values."""
    constant = tuple(part.constant for part in parts)
    return Value("", Tup(tuple(part.type for part in parts)), parts=parts,
                 constant=constant if all(one is not None for one in constant) else None)  # fmt: skip


def is_call(node: Any, name: str) -> bool:
    """True if a node calls a function of Python by this name."""
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name


def safe(name: str) -> str:
    """A name that C does not use otherwise."""
    return f"{name}_" if name in RESERVED else name


def is_word(code: str) -> bool:
    """True if an expression is a name, or a field of one."""
    return code.replace(".", "").replace("_", "a").isalnum()


def is_simple(code: str) -> bool:
    """True if an expression can be written twice."""
    return "&bad" not in code and "&raised" not in code and len(code) < 80


def bare(code: str) -> str:
    """An expression without brackets around the whole of it."""
    if not code.startswith("(") or not code.endswith(")"):
        return code
    depth = 0
    for k, letter in enumerate(code):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and k < len(code) - 1:
            return code
    return code[1:-1]


def arrays_of(code: str, type_: Any) -> list[str]:
    """The arrays within a value."""
    if isinstance(type_, Arr):
        return [code]
    if isinstance(type_, Tup):
        return [path for k, item in enumerate(type_.items) for path in arrays_of(f"{code}.f{k}", item)]
    return []


def drops_of(code: str, type_: Any) -> list[str]:
    """Lines that let go of the memory of a value."""
    return [f"Py_XDECREF({path}.owner);" for path in arrays_of(code, type_)]
