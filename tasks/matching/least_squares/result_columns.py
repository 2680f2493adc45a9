"""Columns of the table in which the kernels leave what they found, one row per point; and the outcomes as plain numbers."""

from orthomill.schemas.outcome import Outcome

COL, ROW, REFERENCE_COL, REFERENCE_ROW, VAR_COL, VAR_ROW, COVARIANCE = range(7)
SIGMA0, CORRELATION, GAIN, OFFSET, A12, A21, B12, B21 = range(7, 15)
COLUMNS = 15

CONVERGED, LOW_TEXTURE, OUTSIDE = int(Outcome.CONVERGED), int(Outcome.LOW_TEXTURE), int(Outcome.OUTSIDE)
NOT_CONVERGED, MOVED_TOO_FAR = int(Outcome.NOT_CONVERGED), int(Outcome.MOVED_TOO_FAR)
SINGULAR, LOW_CORRELATION = int(Outcome.SINGULAR), int(Outcome.LOW_CORRELATION)
