"""The run as a record of ISO 19115: what it is, where, when, in which system, how it came about, and how good it is.

Source: ISO 19115-1:2014 and ISO/TS 19115-3:2016 for the XML.
"""

from orthomill.pipeline.export.metadata.delivered_run import DeliveredRun
from orthomill.pipeline.export.metadata.iso_quality import data_quality, zoned
from orthomill.pipeline.export.metadata.xml_writing import Element, code, document, element, words


def metadata_file(run: DeliveredRun, products: str) -> str:
    """The document; `products`: their folder as seen from it."""
    return document(
        element(
            "mdb:MD_Metadata",
            element("mdb:metadataIdentifier", element("mcc:MD_Identifier", words("mcc:code", run.record.project))),
            element("mdb:defaultLocale", _locale()),
            element("mdb:metadataScope", element("mdb:MD_MetadataScope", code("mdb:resourceScope", "mcc:MD_ScopeCode", "dataset"))),
            element("mdb:contact", _software(run, "processor")),
            element("mdb:dateInfo", _date(zoned(run.record.finished), "creation")),
            element("mdb:metadataStandard", element("cit:CI_Citation", words("cit:title", "ISO 19115-1:2014"))),
            element("mdb:referenceSystemInfo", _system(run)),
            element("mdb:identificationInfo", _identification(run)),
            element("mdb:distributionInfo", _distribution(run, products)),
            element("mdb:dataQualityInfo", data_quality(run)),
            element("mdb:resourceLineage", _lineage(run)),
        )
    )


def _locale() -> Element:
    return element(
        "lan:PT_Locale",
        code("lan:language", "lan:LanguageCode", "eng"),
        code("lan:characterEncoding", "lan:MD_CharacterSetCode", "utf8"),
    )


def _software(run: DeliveredRun, role: str) -> Element:
    party = element("cit:party", element("cit:CI_Organisation", words("cit:name", f"orthomill {run.record.version}")))
    return element("cit:CI_Responsibility", code("cit:role", "cit:CI_RoleCode", role), party)


def _date(time: str, kind: str) -> Element:
    return element(
        "cit:CI_Date", element("cit:date", element("gco:DateTime", time)), code("cit:dateType", "cit:CI_DateTypeCode", kind)
    )


def _system(run: DeliveredRun) -> Element:
    identifier = element("mcc:MD_Identifier", words("mcc:code", run.record.crs))
    return element("mrs:MD_ReferenceSystem", element("mrs:referenceSystemIdentifier", identifier))


def _identification(run: DeliveredRun) -> Element:
    citation = element(
        "cit:CI_Citation",
        words("cit:title", run.record.project),
        element("cit:date", _date(zoned(run.record.finished), "creation")),
    )
    abstract = f"Orthoimage, surface model and points from {len(run.photos.photos)} photographs."
    west, south, east, north = run.box
    box = element(
        "gex:EX_GeographicBoundingBox",
        *(
            element(f"gex:{name}", element("gco:Decimal", f"{value:.8f}"))
            for name, value in (
                ("westBoundLongitude", west),
                ("eastBoundLongitude", east),
                ("southBoundLatitude", south),
                ("northBoundLatitude", north),
            )
        ),
    )
    parts = [element("gex:geographicElement", box)]
    if run.taken:
        first, last = run.taken
        period = element(
            "gml:TimePeriod", element("gml:beginPosition", first), element("gml:endPosition", last), gml_id="photographs-taken"
        )
        parts.append(element("gex:temporalElement", element("gex:EX_TemporalExtent", element("gex:extent", period))))
    cells = sorted({abs(one.map.transform[0]) for one in run.files if one.map})
    distances = (element("mri:distance", element("gco:Distance", f"{cell:g}", uom="m")) for cell in cells)
    resolutions = (element("mri:spatialResolution", element("mri:MD_Resolution", one)) for one in distances)
    return element(
        "mri:MD_DataIdentification",
        element("mri:citation", citation),
        words("mri:abstract", abstract),
        code("mri:spatialRepresentationType", "mcc:MD_SpatialRepresentationTypeCode", "grid"),
        *resolutions,
        element("mri:topicCategory", element("mri:MD_TopicCategoryCode", "imageryBaseMapsEarthCover")),
        element("mri:extent", element("gex:EX_Extent", *parts)),
    )


def _distribution(run: DeliveredRun, products: str) -> Element:
    resources = (
        element(
            "mrd:onLine",
            element(
                "cit:CI_OnlineResource",
                words("cit:linkage", f"{products}/{one.name}"),
                words("cit:name", one.name),
                words("cit:description", f"{one.purpose or one.media}; {one.size} bytes, SHA-256 {one.sha256}"),
            ),
        )
        for one in run.files
    )
    return element("mrd:MD_Distribution", element("mrd:transferOptions", element("mrd:MD_DigitalTransferOptions", *resources)))


def _lineage(run: DeliveredRun) -> Element:
    facts = run.record
    statement = (
        f"Made by orthomill {facts.version} from {len(run.photos.photos)} photographs by the stages "
        f"{', '.join(kind for kind, _, _ in facts.stages)}; {facts.started} to {facts.finished}. The settings of every stage are "
        "in workflow.yaml, from which the run can be repeated."
    )
    sources = (
        element("mrl:source", element("mrl:LI_Source", words("mrl:description", f"Photograph {photo.path}")))
        for photo in run.photos.photos
    )
    return element(
        "mrl:LI_Lineage",
        words("mrl:statement", statement),
        element("mrl:scope", element("mcc:MD_Scope", code("mcc:level", "mcc:MD_ScopeCode", "dataset"))),
        *sources,
    )
