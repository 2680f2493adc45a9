"""What puts the results of a project in doubt is told at the end of a run."""

from memory_store import MemoryStore

from orthomill.pipeline.report.doubts import Doubt, doubts
from orthomill.schemas.stage_report import StageReport, report_table


def test_grave_warnings_come_in_the_order_of_the_stages_and_others_do_not():
    store = MemoryStore()
    store.put_table(report_table("orientation"), StageReport(warnings=("Ordinary.", "No datum."), doubts=("No datum.",)))
    store.put_table(report_table("photos"), StageReport(warnings=("Far.",), doubts=("Far.",)))
    titles = (("photos", "Photographs"), ("texture", "Orthoimage"), ("orientation", "Orientation"))
    assert list(doubts(store, titles)) == [Doubt("Photographs", "Far."), Doubt("Orientation", "No datum.")]
