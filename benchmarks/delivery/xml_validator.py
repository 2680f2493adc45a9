"""Files against ISO's own schemas, run by a Python that has lxml: `python xml_validator.py SCHEMAS OTHERS FILE...`.

SCHEMAS is the folder `schemas.isotc211.org` of the repository ISO-TC211/XML, OTHERS one with `ogc/gml/3.2.1` and `w3c/1999`, as the
wheel of pycsw brings them (`pycsw/core/schemas`). Nothing is fetched. Prints, as JSON, the errors of every file.
"""

import json
import sys
from pathlib import Path

from lxml import etree

WANTED = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="urn:all">
<xs:import namespace="http://standards.iso.org/iso/19115/-3/mds/2.0" schemaLocation="19115/-3/mds/2.0/mds.xsd"/>
<xs:import namespace="http://standards.iso.org/iso/19157/-2/mdq/1.0" schemaLocation="19157/-2/mdq/1.0/mdq.xsd"/>
</xs:schema>"""


class OnDisk(etree.Resolver):
    """Addresses of schemas as files."""

    def __init__(self, schemas: Path, others: Path) -> None:
        super().__init__()
        self._places = {
            "schemas.isotc211.org/": schemas,
            "standards.iso.org/iso/": schemas,
            "schemas.opengis.net/": others / "ogc",
            "www.w3.org/": others / "w3c",
        }

    def resolve(self, url, public, context):
        """The file that stands for an address."""
        bare = url.partition("://")[2]
        for start, folder in self._places.items():
            if bare.startswith(start) and (folder / bare[len(start) :]).exists():
                return self.resolve_filename(str(folder / bare[len(start) :]), context)
        return None


def main() -> None:
    """Validates the files."""
    schemas, others = map(Path, sys.argv[1:3])
    parser = etree.XMLParser(no_network=True)
    parser.resolvers.add(OnDisk(schemas, others))
    schema = etree.XMLSchema(etree.fromstring(WANTED, parser, base_url=f"{schemas}/all.xsd"))
    found = {}
    for file in sys.argv[3:]:
        schema.validate(etree.parse(file))
        found[file] = [f"line {error.line}: {error.message}" for error in schema.error_log]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
