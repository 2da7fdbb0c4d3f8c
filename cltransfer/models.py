"""Networks the built-in extractors were written for: what the file is, whose it is and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class KnownModel:
    """One ONNX file.

    Args:
        sha256: of the file; another file of the same name is refused.
        licence: of the weights.
        source: repository, commit and path; "converted" where that file is not ONNX yet.
    """

    sha256: str
    licence: str
    source: str


_MEDIAPIPE = "google-ai-edge/mediapipe @ a715f1ec4d3360f6256bc5ec84c45a93265dc3b7"
_YOLOX = "Kazuhito00/Image-Processing-Node-Editor @ 46979d5b8eacb181abe970e4dd18e8f4cf0e750b"

KNOWN = {
    "yolox_nano.onnx": KnownModel(
        "695e750a5d5754bb5a8d5325643b59282191a7e7a564e435a415fd3c578eab14",
        "Apache-2.0",
        f"{_YOLOX} : node/deep_learning_node/object_detection/YOLOX/model/yolox_nano.onnx",
    ),
    "mp_pose_landmark_lite.onnx": KnownModel(
        "40b140d5fb79f7f5b964c9f08af8c26a36a1bbfa68998f5b436727d052866dd8",
        "Apache-2.0",
        f"{_MEDIAPIPE} : mediapipe/modules/pose_landmark/pose_landmark_lite.tflite, converted",
    ),
}
