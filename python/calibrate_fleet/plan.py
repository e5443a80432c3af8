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


def name_of(path, vehicle):
    """@return VEHICLE/BAG, whatever the layout of the folder is"""
    words = [re.sub(r"[^\w.-]+", "_", word) for word in (vehicle, path.with_suffix("").as_posix().replace("/", "_"))]
    own = words[1][len(words[0]) + 1:] if words[1].startswith(words[0] + "_") else ""
    return "{}/{}".format(words[0], own or words[1])


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
        vehicle = match.group("vehicle")
        runs.append({"name": name_of(relative, vehicle), "vehicle": vehicle, "bag": str(bag.resolve())})
    seen = set()
    for run in runs:
        if run["name"] in seen:
            raise PlanError("{}: another bag would have the same name, {}; rename one".format(run["bag"], run["name"]))
        seen.add(run["name"])
    if not runs:
        raise PlanError("{}: no bag fits the pattern {}, e.g. {}; name your layout with --vehicle, such as '{{vehicle}}/**' "
                        "or '{{vehicle}}_*.bag'".format(folder, pattern, others[0].relative_to(folder)))
    return runs, others
