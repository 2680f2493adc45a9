"""Where the products come from, as PROV has it: the run with its stages, photographs and workflow used, files generated, by which
version.

Source: W3C, PROV-DM (2013) and PROV-JSON (member submission 2013).
"""

import hashlib
import json
from typing import Any

from orthomill.pipeline.export.metadata.delivered_run import DeliveredRun
from orthomill.pipeline.export.metadata.iso_quality import zoned

_SPACES = {"orthomill": "urn:orthomill:", "prov": "http://www.w3.org/ns/prov#", "xsd": "http://www.w3.org/2001/XMLSchema#"}
_SOFTWARE = {"$": "prov:SoftwareAgent", "type": "prov:QUALIFIED_NAME"}


def provenance_record(run: DeliveredRun) -> str:
    """The record as PROV-JSON."""
    facts, run_name = run.record, f"orthomill:run/{run.record.project}"
    software = f"orthomill:software/{facts.version}"
    workflow = f"orthomill:workflow/{facts.project}"
    entities: dict[str, Any] = {
        workflow: {"prov:label": "workflow.yaml", "orthomill:sha256": hashlib.sha256(facts.workflow.encode()).hexdigest()}
    }
    activities: dict[str, Any] = {run_name: _activity(f"run of {facts.project}", facts.started, facts.finished)}
    record: dict[str, dict[str, Any]] = {"used": {}, "wasGeneratedBy": {}, "wasDerivedFrom": {}, "wasInformedBy": {}}
    _relate(record, "used", {"prov:activity": run_name, "prov:entity": workflow})
    for photo in run.photos.photos:
        name = f"orthomill:photograph/{photo.name}"
        entities[name] = {"prov:label": photo.path, **({"orthomill:taken": photo.time} if photo.time else {})}
        _relate(record, "used", {"prov:activity": run_name, "prov:entity": name})
    for kind, seconds, jobs in facts.stages:
        name = _stage(facts.project, kind)
        activities[name] = {"prov:label": kind, "orthomill:seconds": round(seconds, 1), "orthomill:jobs": jobs}
        _relate(record, "wasInformedBy", {"prov:informed": name, "prov:informant": run_name})
    kinds = {kind for kind, _, _ in facts.stages}
    for one in run.files:
        name = f"orthomill:product/{one.name}"
        entities[name] = {
            "prov:label": one.purpose or one.name,
            "prov:location": f"products/{one.name}",
            "orthomill:bytes": one.size,
            "orthomill:sha256": one.sha256,
        }
        by = _stage(facts.project, one.stage) if one.stage in kinds else run_name
        _relate(record, "wasGeneratedBy", {"prov:entity": name, "prov:activity": by})
    content = {
        "prefix": _SPACES,
        "entity": entities,
        "activity": activities,
        "agent": {software: {"prov:type": _SOFTWARE, "prov:label": f"orthomill {facts.version}"}},
        "wasAssociatedWith": {"_:associated": {"prov:activity": run_name, "prov:agent": software, "prov:plan": workflow}},
        **{relation: items for relation, items in record.items() if items},
    }
    return json.dumps(content, indent=1) + "\n"


def _activity(label: str, started: str, finished: str) -> dict[str, Any]:
    return {"prov:label": label, "prov:startTime": zoned(started), "prov:endTime": zoned(finished)}


def _stage(project: str, kind: str) -> str:
    return f"orthomill:stage/{project}/{kind}"


def _relate(record: dict[str, dict[str, Any]], relation: str, what: dict[str, str]) -> None:
    record[relation][f"_:{relation}{len(record[relation]) + 1}"] = what
