"""A mechanism in the browser, moved and drawn by hand: `ksd live SCENE.toml`, `ksd.live`."""
