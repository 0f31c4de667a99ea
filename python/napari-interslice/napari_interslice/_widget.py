"""The widget: fill the slices between painted ones, preview, keep or drop."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import interslice
import numpy as np
from napari.layers import Labels
from napari.qt.threading import thread_worker
from qtpy.QtCore import QObject, Signal
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

if TYPE_CHECKING:
    import napari

# In words, and what the settings say.
METHODS = {"accurate (contours morph)": "morph", "fast (distances interpolated)": "field"}
ENDS = {"end flat at the last slice": "flat", "go on for half a gap": "half-slice", "close as the body does": "extrapolate"}
PREVIEW = "filled (preview)"
MARKED = "interpolated"


class Cancelled(Exception):
    """The user has seen enough."""


class Told(QObject):  # type: ignore[misc]
    """Progress, from the worker's thread to the widget's."""

    progressed = Signal(str, int, int)


class FillWidget(QWidget):  # type: ignore[misc]
    """Fills a Labels layer."""

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.viewer = napari_viewer
        self.layer = QComboBox()
        self.which = QComboBox()
        self.which.addItems(["the selected label", "all labels"])
        self.method = QComboBox()
        self.method.addItems(METHODS)
        self.ends = QComboBox()
        self.ends.addItems(ENDS)
        self.axis = QComboBox()
        self.axis.addItems(["found by itself", "axis 0", "axis 1", "axis 2"])
        self.mark = QCheckBox("mark what was interpolated")
        self.mark.setChecked(True)
        self.start = QPushButton("Fill")
        self.stop = QPushButton("Cancel")
        self.keep = QPushButton("Keep")
        self.drop = QPushButton("Drop")
        self.bar = QProgressBar()
        self.said = QLabel("Paint a label on some slices, then fill what lies between.")
        self.said.setWordWrap(True)
        self.said.setMinimumHeight(64)
        form = QFormLayout()
        for words, widget in (
            ("Layer", self.layer),
            ("Fill", self.which),
            ("Method", self.method),
            ("Ends", self.ends),
            ("Slices along", self.axis),
        ):
            form.addRow(words, widget)
        form.addRow(self.mark)
        layout = QVBoxLayout(self)
        layout.addLayout(form)
        for pair in ((self.start, self.stop), (self.keep, self.drop)):
            row = QHBoxLayout()
            for button in pair:
                row.addWidget(button)
            layout.addLayout(row)
        layout.addWidget(self.bar)
        layout.addWidget(self.said)
        layout.addStretch()
        self.start.clicked.connect(self.fill)
        self.stop.clicked.connect(self.cancel)
        self.keep.clicked.connect(self.take)
        self.drop.clicked.connect(self.forget)
        self.viewer.layers.events.inserted.connect(self._list)
        self.viewer.layers.events.removed.connect(self._list)
        self._worker: Any = None
        self._told = Told()
        self._told.progressed.connect(self._progress)
        self._cancelled = False
        # The layer that is filled, and the voxels of the preview.
        self._of: Labels | None = None
        self._filled: np.ndarray[Any, Any] | None = None
        self._list()
        self._state(running=False)

    def _list(self, _event: object = None) -> None:
        """Lists the Labels layers."""
        name = self.layer.currentText()
        own = (PREVIEW, MARKED)
        names = [layer.name for layer in self.viewer.layers if isinstance(layer, Labels) and layer.name not in own]
        self.layer.clear()
        self.layer.addItems(names)
        if name in names:
            self.layer.setCurrentText(name)

    def _state(self, running: bool) -> None:
        self.start.setEnabled(not running)
        self.stop.setEnabled(running)
        self.keep.setEnabled(self._filled is not None)
        self.drop.setEnabled(self._filled is not None)
        self.bar.setVisible(running)

    def fill(self) -> None:
        """Begins to fill, in the background."""
        self.forget()
        if not self.layer.currentText():
            self.said.setText("There is no Labels layer to fill.")
            return
        layer = self.viewer.layers[self.layer.currentText()]
        if layer.ndim != 3:
            self.said.setText(f"The layer must have 3 axes; `{layer.name}` has {layer.ndim}.")
            return
        axis = self.axis.currentIndex() - 1
        end = ENDS[self.ends.currentText()]
        only = [int(layer.selected_label)] if self.which.currentIndex() == 0 else None
        options: dict[str, Any] = {
            "spacing": [abs(float(h)) for h in layer.scale],
            "axis": None if axis < 0 else axis,
            "only": only,
            "method": METHODS[self.method.currentText()],
            "end_top": end,
            "end_bottom": end,
        }
        # What is painted meanwhile is not filled.
        data = np.array(layer.data)
        self._of, self._cancelled = layer, False

        def told(stage: str, done: int, total: int) -> None:
            if self._cancelled:
                raise Cancelled
            self._told.progressed.emit(stage, done, total)

        @thread_worker  # type: ignore[untyped-decorator]
        def work() -> tuple[np.ndarray[Any, Any] | None, Exception | None]:
            # What goes wrong is told in the widget, not as a crash.
            try:
                return np.asarray(interslice.fill(data, progress=told, **options)), None
            except Exception as error:
                return None, error

        self._worker = work()
        self._worker.returned.connect(lambda result: self._done(layer, data, *result))
        self._worker.finished.connect(lambda: self._state(running=False))
        self._state(running=True)
        self.bar.setRange(0, 0)
        self.said.setText("Filling ...")
        self._worker.start()

    def _progress(self, stage: str, done: int, total: int) -> None:
        if not self.stop.isEnabled():
            return
        self.bar.setRange(0, max(total, 1))
        self.bar.setValue(min(done, total))
        self.said.setText(f"{stage} ...")

    def cancel(self) -> None:
        """Ends the work within about a second."""
        self._cancelled = True

    def _done(
        self,
        layer: Labels,
        before: np.ndarray[Any, Any],
        filled: np.ndarray[Any, Any] | None,
        error: Exception | None,
    ) -> None:
        if self._cancelled or filled is None:
            self.said.setText("Cancelled." if self._cancelled else str(error))
        else:
            self._preview(layer, before, filled)

    def _preview(self, layer: Labels, before: np.ndarray[Any, Any], filled: np.ndarray[Any, Any]) -> None:
        self._filled = filled
        place = {key: getattr(layer, key) for key in ("scale", "translate", "rotate", "shear", "affine", "units")}
        preview = self.viewer.add_labels(filled, name=PREVIEW, opacity=0.6, colormap=layer.colormap, **place)
        preview.editable = False
        new = (filled != 0) & (before == 0)
        if self.mark.isChecked():
            marked = self.viewer.add_labels(new.astype(np.uint8), name=MARKED, opacity=0.4, visible=False, **place)
            marked.editable = False
        self.said.setText(f"{int(new.sum())} voxels were filled. Keep them, or drop them.")
        self.viewer.layers.selection.active = layer
        self._state(running=False)

    def take(self) -> None:
        """Puts the preview into the layer, as one step that can be undone."""
        layer, filled = self._of, self._filled
        if layer is None or filled is None or layer not in self.viewer.layers:
            return
        # What was painted since is not painted over.
        places = np.nonzero((filled != 0) & (np.asarray(layer.data) == 0))
        layer.data_setitem(places, filled[places])
        self._clear(keep=(MARKED,))
        self.said.setText(f"{len(places[0])} voxels were put into `{layer.name}`; undo takes them back.")

    def forget(self) -> None:
        """Drops the preview."""
        if self._filled is not None:
            self._clear(keep=())
            self.said.setText("Dropped.")

    def _clear(self, keep: tuple[str, ...]) -> None:
        self._filled = None
        for name in (PREVIEW, MARKED):
            if name in self.viewer.layers and name not in keep:
                self.viewer.layers.remove(name)
        self._state(running=False)
