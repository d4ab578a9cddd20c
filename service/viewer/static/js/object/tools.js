// The buttons on the stage: the view from the start, and all of the screen.

const fullscreen = document.getElementById("fullscreen");

/** Set up the buttons; `reset()` returns the camera to its start. */
export function startTools(reset) {
  document.getElementById("reset").addEventListener("click", reset);
  fullscreen.hidden = !document.fullscreenEnabled;
  fullscreen.addEventListener("click", toggleFullscreen);
}

function toggleFullscreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else document.getElementById("stage").requestFullscreen();
}
