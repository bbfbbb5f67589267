"""Fails if a test, or a block of a page, was skipped in every run of pytest: python skipped.py RESULTS.xml..."""

import sys
from xml.etree import ElementTree

run: set[tuple[str, str]] = set()
skipped: dict[tuple[str, str], str] = {}
for case in (case for file in sys.argv[1:] for case in ElementTree.parse(file).iter("testcase")):
    # A file that is skipped whole has no class.
    name = (case.get("classname") or case.get("name") or "", case.get("name") if case.get("classname") else "")
    reason = case.find("skipped")
    if reason is None:
        run |= {name, (name[0], "")}
    else:
        skipped[name] = reason.get("message") or ""
    # A test of a page says which of its blocks it ran, and what the others need.
    for said in case.iter("property"):
        block = (name[0], f"{name[1]}, {said.get('name')}")
        if said.get("value") == "ran":
            run.add(block)
        else:
            skipped[block] = said.get("value") or ""
never = {name: reason for name, reason in skipped.items() if name not in run}
for (file, test), reason in sorted(never.items()):
    print(f"{file} {test}: skipped in every environment: {reason}")
print(f"{len(run)} tests and files were run in one environment or more, {len(never)} in none")
sys.exit(bool(never))
