// Colours of the page: light; dark; and red, in which the screen sends no green or blue light, so that eyes stay adapted to
// the dark and the target is hardly lit. The picture keeps its colours in the dark. Arguments: theme, and those before.

const THEMES = [
  {tint: "none", whole: "none", ground: "#ffffff"},
  {tint: "invert(0.92) hue-rotate(180deg)", whole: "none", ground: "#141414"},
  {tint: "invert(1) grayscale(1)", whole: "url(#labcdp-red)", ground: "#000000"},
]
const filters = document.createElement("div")
filters.style.cssText = "position: absolute; width: 0; height: 0; overflow: hidden"
filters.innerHTML = '<svg><filter id="labcdp-red" color-interpolation-filters="sRGB"><feColorMatrix'
  + ' values="0.38 0.74 0.14 0 0  0 0 0 0 0  0 0 0 0 0  0 0 0 1 0"/></filter></svg>'
document.body.append(filters)

function set_theme() {
  const {tint, whole, ground} = THEMES[theme.active]
  const root = document.documentElement
  root.style.setProperty("--tint", tint)
  root.style.filter = whole
  root.style.background = document.body.style.background = ground
  localStorage.setItem("labcdp theme", theme.active)
}
theme.properties.active.change.connect(set_theme)
const dark = window.matchMedia("(prefers-color-scheme: dark)").matches ? 1 : 0
theme.active = Number(localStorage.getItem("labcdp theme") ?? dark)
set_theme()
