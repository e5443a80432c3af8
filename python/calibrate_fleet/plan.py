"""Which bags there are, and which vehicle each is of."""
import re

VEHICLE = "{vehicle}"


class PlanError(Exception):
    """The folder or the pattern does not fit; the text says what to do."""


def expression(pattern):
    """@return compiled regular expression of a pattern of paths: {vehicle} and * stand for what has no slash, ** for all"""
    if pattern.count(VEHICLE) != 1:
        raise PlanError("--vehicle {}: the pattern must hold {} once".format(pattern, VEHICLE))
    parts = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*", VEHICLE: "(?P<vehicle>[^/]+?)"}
    words = re.split(r"(\*\*/|\*\*|\*|\{vehicle\})", pattern)
    return re.compile("".join(parts.get(word, re.escape(word)) for word in words) + r"\Z")


def find_runs(folder, pattern):
    """@return runs, a list of {name, vehicle, bag} in the order of the names, and the bags that the pattern does not fit"""
    expected = expression(pattern)
    bags = sorted(path for path in folder.rglob("*.bag") if path.is_file())
    if not bags:
        raise PlanError("{}: there is no bag in it".format(folder))
    runs, others = [], []
    for bag in bags:
        relative = bag.relative_to(folder)
        match = expected.match(relative.as_posix())
        if match is None:
            others.append(bag)
            continue
        # A name is a path of its own below the vehicle, whatever else the folder's layout is.
        stem = re.sub(r"[^\w.-]+", "_", relative.with_suffix("").as_posix().replace("/", "_"))
        runs.append({"name": "{}/{}".format(match.group("vehicle"), stem), "vehicle": match.group("vehicle"),
                     "bag": str(bag.resolve())})
    if not runs:
        raise PlanError("{}: no bag fits the pattern {}, e.g. {}; name your layout with --vehicle, such as '{{vehicle}}/**' "
                        "or '{{vehicle}}_*.bag'".format(folder, pattern, others[0].relative_to(folder)))
    return runs, others
