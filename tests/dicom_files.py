"""DICOM files as pydicom writes them, with a patient in them that nobody may find again."""

from __future__ import annotations

from io import BytesIO
from typing import Any

import pydicom
from pydicom.uid import UID, ExplicitVRLittleEndian

PATIENT = "PLANTED^NAME"
XA = "1.2.840.10008.5.1.4.1.1.12.1"
GEOMETRY: dict[str, Any] = {
    "DistanceSourceToDetector": "1100", "DistanceSourceToPatient": "750", "PositionerPrimaryAngle": "30",
    "PositionerSecondaryAngle": "-12.5", "ImagerPixelSpacing": ["0.2", "0.2"], "Rows": 900, "Columns": 1024,
}  # fmt: skip


def write_image(syntax: UID = ExplicitVRLittleEndian, sop: str = XA, **changes: Any) -> bytes:
    """A file with these tags instead of those of GEOMETRY; None: without."""
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = UID(sop), UID("1.2.3")
    meta.TransferSyntaxUID = syntax
    data = pydicom.Dataset()
    data.file_meta = meta
    data.SOPClassUID, data.PatientName, data.PatientID = UID(sop), PATIENT, PATIENT
    data.OtherPatientIDsSequence = [pydicom.Dataset()]
    data.OtherPatientIDsSequence[0].PatientID = PATIENT
    for keyword, value in (GEOMETRY | changes).items():
        if value is not None:
            setattr(data, keyword, value)
    if syntax.is_encapsulated:
        data.PixelData = pydicom.encaps.encapsulate([b"\xff\xd8" * 500])
        data["PixelData"].is_undefined_length = True
    else:
        data.PixelData = b"\1\2" * 2000
        data["PixelData"].VR = "OW"
    file = BytesIO()
    data.save_as(file, enforce_file_format=True)
    return file.getvalue()
