"""One empty page of Qt WebEngine, which Playwright fills; `browser.py` starts it as a process of its own."""

import sys

from PySide6.QtCore import QUrl
from PySide6.QtWebEngineWidgets import QWebEngineView
from PySide6.QtWidgets import QApplication

application = QApplication(sys.argv[:1])
view = QWebEngineView()
view.setUrl(QUrl("about:blank"))
view.show()
sys.exit(application.exec())
