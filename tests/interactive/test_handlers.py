"""Every handler of the page shows what goes wrong in it, and the page goes on: raised in each, without a browser."""

import asyncio
import inspect
from types import SimpleNamespace

import pytest

pytest.importorskip("nicegui", reason="the extra `live` is not installed")

from nicegui.testing import user_simulation

from ksd.errors import SceneError
from ksd.interactive.page import Viewer
from ksd.interactive.session import Session
from ksd.scene.toml_file import load_scene, shipped_scenes


class Broken:
    """Stands for what a handler uses, and fails at every use."""

    def __getattr__(self, name):
        raise SceneError(f"{name} fails by hand")


def test_every_handler_shows_its_sentence(monkeypatch):
    viewers, guarded = [], []
    guard = Viewer.guarded

    def collecting(self, handler):
        guarded.append(guard(self, handler))
        return guarded[-1]

    monkeypatch.setattr(Viewer, "guarded", collecting)

    async def run():
        async with user_simulation(root=lambda: viewers.append(Viewer(session))) as user:
            await user.open("/")
            viewer = viewers[-1]
            viewer._start(None)
            # what is no event of ours is the library's own, such as that of a closed notification
            assert len(guarded) >= 12
            own = [v for v in vars(viewer) if v not in ("ui", "client", "loop")]
            for handler in guarded:
                kept = {v: getattr(viewer, v) for v in own}
                for v in own:
                    setattr(viewer, v, Broken())
                said = len(user.notify.messages)
                needed = [p for p in inspect.signature(handler).parameters.values() if p.default is p.empty]
                result = handler(*[SimpleNamespace(args=Broken())] * len(needed))
                if asyncio.iscoroutine(result):
                    await result
                for v, value in kept.items():
                    setattr(viewer, v, value)
                assert len(user.notify.messages) > said, handler.__wrapped__
                assert "by hand" in user.notify.messages[-1] or "Broken" in user.notify.messages[-1]
            viewer._show(session.latest)

    mechanism, targets, _ = load_scene(shipped_scenes()["gripper"])
    session = Session(mechanism, targets)
    session.refresh()
    session.settle()
    try:
        asyncio.run(run())
    finally:
        session.close()
    # nothing on the page is without a guard
    source = inspect.getsource(inspect.getmodule(Viewer))
    for line in source.splitlines():
        if ".on(" in line or "on_click=" in line or "on_change=" in line or "on_value_change(" in line:
            assert "self.guarded(" in line, line
