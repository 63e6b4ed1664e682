"""Small changes ("mutants") of Fortran sources, all of them in one program.

Each mutant changes one statement. The instrumented source holds the original and its mutants side by side and
asks `mutant_is(number)`, which a program settles from DYNSTICTION_MUTANT when it starts (mutant.c). So
one build serves all mutants. Declarations, initial values, formats and array subscripts are left alone.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

TOKEN = re.compile(
    r"""'(?:[^']|'')*'|"(?:[^"]|"")*"|\d+\.\d*(?:[eE][-+]?\d+)?(?:_\w+)?|\d+(?:_\w+)?|\.[a-zA-Z]+\.|[a-zA-Z]\w*"""
    r"""|\*\*|==|/=|<=|>=|=>|//|::|\S"""
)
PROCEDURE = re.compile(r"^(?!end )(?:[\w ]|\([\w*:=]*\))*\b(?:subroutine|function) (\w+)")
ASSIGNMENT = re.compile(r"^[a-z]\w*(?:\([^=]*\))?(?:%\w+(?:\([^=]*\))?)*\s*=(?![=>])\s*(.+)$", re.IGNORECASE)
KEYWORDS = ("if", "else", "do", "end", "select", "case", "call", "where", "associate", "type", "class", "use", "allocate", "write",
            "read", "deallocate", "open", "close", "print", "inquire", "forall", "block", "interface", "import")  # fmt: skip
# Functions whose integer arguments are numbers, not dimensions or kinds.
NUMERIC = frozenset(
    ("abs", "acos", "asin", "atan2", "cos", "exp", "log", "max", "maxval", "merge", "min", "minval", "mod", "modulo", "nint",
     "product", "real", "sign", "sin", "sqrt", "sum", "tan")
)  # fmt: skip
INTEGERS = frozenset(
    ("i", "j", "k", "l", "m", "n", "s", "axis", "first", "last", "degree", "stages", "column", "segment", "size")
)  # fmt: skip
RELATIONS = {"<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("/=",), "/=": ("==",)}
SWAPS = {"+": "-", "-": "+", "*": "/", "/": "*", ".and.": ".or.", ".or.": ".and.", "min": "max", "max": "min",
         ".true.": ".false.", ".false.": ".true."}  # fmt: skip


Key = tuple[str, str, str, str, int]


@dataclass
class Mutant:
    """One change of one statement. `part` is the part of the statement that `mutated` replaces."""

    file: str
    line: int
    procedure: str
    original: str
    mutated: str
    part: str
    occurrence: int = 0
    number: int = 0

    @property
    def key(self) -> Key:
        """What names the mutant, whatever else changes in the file."""
        return (self.file, self.procedure, self.original, self.mutated, self.occurrence)

    def rank(self, seed: int, weight: float) -> float:
        """A random number that depends only on seed and mutant: the choice elsewhere does not change it."""
        digest = hashlib.sha256(repr((seed, self.key)).encode()).digest()
        uniform = (int.from_bytes(digest[:7], "big") + 1) / 2**56
        return uniform ** (1.0 / weight)


@dataclass
class Statement:
    """A statement on one line, where it began, and the procedure that it belongs to."""

    line: int
    text: str
    procedure: str


@dataclass
class Source:
    """The statements of a file and the mutants of each."""

    name: str
    statements: list[Statement]
    mutants: dict[int, list[Mutant]] = field(default_factory=dict)


def without_comment(line: str) -> str:
    quote = ""
    for i, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character == "!":
            return line[:i].rstrip()
    return line.rstrip()


def read_source(name: str, text: str) -> Source:
    """Join continued lines, drop comments, note the procedures, and find all mutants."""
    statements = []
    # An include file is the inside of a procedure.
    procedures = [name.partition(".")[0]] if name.endswith(".inc") else []
    pending, start = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        bare = without_comment(line).strip()
        if not bare:
            continue
        start = start if pending else number
        pending += bare.removeprefix("&").lstrip() if pending else bare
        if pending.endswith("&"):
            pending = pending[:-1].rstrip() + " "
            continue
        opened = PROCEDURE.match(pending)
        if opened:
            procedures.append(opened[1])
        statements.append(Statement(start, pending, procedures[-1] if procedures else ""))
        if re.match(r"end (subroutine|function)", pending):
            procedures.pop()
        pending = ""
    source = Source(name, statements)
    seen: dict[tuple[str, str, str], int] = {}
    for i, statement in enumerate(statements):
        found = []
        for part, mutated in mutations(statement.text):
            key = (statement.procedure, statement.text, mutated)
            seen[key] = seen.get(key, -1) + 1
            found.append(Mutant(name, statement.line, statement.procedure, statement.text, mutated, part, seen[key]))
        if found and statement.procedure:
            source.mutants[i] = found
    return source


def split_if(text: str) -> tuple[str, str, str] | None:
    """'if (', condition, ') then' or ') statement'."""
    opened = re.match(r"(?:else )?if \(|do while \(", text)
    if not opened:
        return None
    depth, quote = 1, ""
    for i in range(opened.end(), len(text)):
        character = text[i]
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        else:
            depth += (character == "(") - (character == ")")
        if depth == 0:
            return opened[0], text[opened.end() : i], text[i:]
    return None


def mutations(text: str) -> Iterator[tuple[str, str]]:
    """The part of the statement that changes, and the whole of what stands there instead."""
    conditional = split_if(text)
    if conditional:
        _, condition, rest = conditional
        for changed in changes(condition):
            yield "condition", changed
        if not any(token in RELATIONS for token in TOKEN.findall(condition)):
            yield "condition", f".not. ({condition})"
        action = rest[1:].strip()
        if action in ("return", "exit", "cycle"):
            yield "condition", ".false."
        elif action and action != "then":
            for part, changed in mutations(action):
                yield f"action {part}", changed
        return
    loop = re.match(r"do (\w+) = ([^,]+), ([^,]+)$", text)
    if loop and all(part.count("(") == part.count(")") for part in loop.groups()):
        yield "statement", f"do {loop[1]} = {loop[2]} + 1, {loop[3]}"
        yield "statement", f"do {loop[1]} = {loop[2]}, {loop[3]} - 1"
        return
    if text.startswith("call "):
        yield "statement", ""
        return
    assigned = ASSIGNMENT.match(text)
    if not assigned or re.match(r"\w+", text)[0] in KEYWORDS:  # type: ignore[index]
        return
    value = assigned[1]
    left = text[: -len(value)]
    if left.count("(") != left.count(")"):
        return
    yield "statement", ""
    for changed in changes(value):
        yield "statement", left + changed
    tokens = TOKEN.findall(value)
    logical = any(token in RELATIONS or token.startswith((".", "'", '"')) for token in tokens)
    reckoned = any(token in "+-*/" for token in tokens) or "_wp" in value
    if reckoned and not logical and not re.match(r"-?[\d.e]+(_wp)?$|\[|\w+_t\(", value):
        yield "statement", f"{left}-({value})"


def changes(expression: str) -> Iterator[str]:
    """The expression with one operator, function or number changed."""
    places = [(found.start(), found[0]) for found in TOKEN.finditer(expression)]
    tokens = [token for _, token in places]
    fixed = subscripts(tokens)
    for k, (start, token) in enumerate(places):
        if k in fixed:
            continue
        before, after = expression[:start], expression[start + len(token) :]
        previous = tokens[k - 1] if k else ""
        following = tokens[k + 1] if k + 1 < len(tokens) else ""
        binary = bool(re.match(r"[\w.'\")\]]", previous)) and previous not in (".and.", ".or.", ".not.")
        if token in RELATIONS:
            for other in RELATIONS[token]:
                yield before + other + after
        elif token in ("min", "max", "abs"):
            if following == "(" and previous != "%":
                yield before + SWAPS.get(token, "") + after
        elif token in "+-":
            yield before + (SWAPS[token] if binary else "") + after
        elif token in SWAPS:
            yield before + SWAPS[token] + after
        elif token == ".not.":
            yield before + after
        elif re.match(r"\d", token):
            yield before + other_number(token) + after


def other_number(token: str) -> str:
    digits, _, kind = token.partition("_")
    kind = kind and "_" + kind
    if "." not in digits:
        return f"{int(digits) + 1}{kind}"
    value = float(digits)
    if value == 0.0:
        return "1.0" + kind
    if value == 1.0:
        return "2.0" + kind
    if value == 0.5:
        return "0.6" + kind
    return f"(1.1{kind}*{token})"


def subscripts(tokens: list[str]) -> set[int]:
    """Tokens that count, not measure: inside subscripts, dimensions and the arguments of functions of integers."""
    fixed: set[int] = set()
    opened: list[int] = []
    for k, token in enumerate(tokens):
        if token in "([":
            opened.append(k)
        elif token in ")]":
            first = opened.pop()
            name = tokens[first - 1] if first and tokens[first] == "(" and re.match(r"[a-zA-Z]", tokens[first - 1]) else ""
            if not name or (name in NUMERIC and tokens[max(first - 2, 0)] != "%"):
                continue
            inside = tokens[first + 1 : k]
            names = [token for token in inside if re.match(r"[a-zA-Z]", token)]
            if (
                ":" in inside
                or any(re.match(r"\d+$", token) for token in inside)
                or all(token in INTEGERS or token.startswith("column_") for token in names)
            ):
                fixed.update(range(first + 1, k))
    return fixed


def instrumented(source: Source, chosen: dict[int, Mutant]) -> tuple[str, dict[int, list[int]]]:
    """The source with the chosen mutants (by number), and for each of its lines the mutants that are on it."""
    by_statement: dict[int, list[Mutant]] = {}
    for i, found in source.mutants.items():
        here = [mutant for mutant in found if mutant.number in chosen]
        if here:
            by_statement[i] = here
    lines: list[str] = []
    places: dict[int, list[int]] = {}

    def put(text: str, *mutants: Mutant) -> None:
        lines.append(text)
        if mutants:
            places[len(lines)] = [mutant.number for mutant in mutants]

    for i, statement in enumerate(source.statements):
        here = by_statement.get(i, [])
        if here:
            write_statement(statement.text, here, put)
        else:
            put(statement.text)
        if re.match(r"module \w+$", statement.text):
            put("use dst_mutant, only: mutant_is")
    return "\n".join(lines) + "\n", places


def write_statement(text: str, mutants: list[Mutant], put) -> None:
    conditional = split_if(text)
    if conditional:
        head, condition, rest = conditional
        on_condition = [mutant for mutant in mutants if mutant.part == "condition"]
        on_action = [mutant for mutant in mutants if mutant.part != "condition"]
        if on_condition:
            # Neither side is evaluated when the other one is active: gfortran stops at the first that decides.
            cases = [f"(mutant_is({mutant.number}) .and. ({mutant.mutated}))" for mutant in on_condition]
            none = " .and. ".join(f".not. mutant_is({mutant.number})" for mutant in on_condition)
            condition = " .or. ".join([*cases, f"({none} .and. ({condition}))"])
        if not on_action:
            put(f"{head}{condition}{rest}", *on_condition)
            return
        put(f"{head}{condition}) then", *on_condition)
        write_choice(rest[1:].strip(), on_action, put)
        put("end if")
    elif text.startswith("do "):
        original = re.match(r"do (\w+) = ([^,]+), ([^,]+)$", text)
        first, last = original[2], original[3]
        for mutant in mutants:
            if mutant.mutated.endswith(" - 1") and mutant.mutated.startswith(f"do {original[1]} = {first}, "):
                last += f" - merge(1, 0, mutant_is({mutant.number}))"
            else:
                first += f" + merge(1, 0, mutant_is({mutant.number}))"
        put(f"do {original[1]} = {first}, {last}", *mutants)
    else:
        write_choice(text, mutants, put)


def write_choice(text: str, mutants: list[Mutant], put) -> None:
    word = "if"
    for mutant in mutants:
        put(f"{word} (mutant_is({mutant.number})) then", mutant)
        put(mutant.mutated or "continue", mutant)
        word = "else if"
    put("else")
    put(text)
    put("end if")
