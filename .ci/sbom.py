"""Notes in bills of materials (CycloneDX) which crates were built with the patches of bridge/patches, takes the folder
of the builder out of them, and checks them.

    sbom.py FILE...
"""

import json
import pathlib
import sys

root = pathlib.Path(__file__).parent.parent.resolve()
patches = root / "bridge" / "patches"
patched = {folder.name: sorted(folder.glob("*.patch")) for folder in patches.iterdir() if folder.is_dir()}
found = set()
for path in map(pathlib.Path, sys.argv[1:]):
    bill = json.loads(path.read_text().replace(root.as_uri(), "file:///sidehill"))
    components = bill["components"]
    assert bill["bomFormat"] == "CycloneDX" and len(components) > 100, path
    for component in components:
        crate = f"{component['name']}-{component['version']}"
        if crate in patched:
            found.add(crate)
            component["pedigree"] = {
                "patches": [
                    {"type": "unofficial", "diff": {"text": {"content": patch.read_text()}}} for patch in patched[crate]
                ]
            }
    path.write_text(json.dumps(bill, indent=2) + "\n")
missing = sorted(patched.keys() - found)
sys.exit(f"no bill of materials has {', '.join(missing)}" if missing else 0)
