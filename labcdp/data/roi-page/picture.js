// What is seen of the picture and of the drawing; gestures.js, which follows, has mouse and keys. What is drawn here is a
// preview: labcdp keeps the drawing, checks each change, and sends the state that counts. Arguments: figure, link, modes,
// hint, draft, shapes, handles, labels (models of Bokeh).

const MODES = ["select", "polygon", "rectangle", "ellipse", "line"]
const HINTS = {
  select: "Click a region to select it. Drag its corners, or drag inside it to move it. Double-click on an edge adds a"
    + " corner, Alt + click on a corner removes it. Drag beside it moves the picture, the wheel zooms.",
  polygon: "Click corner after corner; close with a click on the first corner, a double-click, a right click or Enter."
    + " Backspace takes back a corner, Esc gives up.",
  rectangle: "Drag from one corner to the opposite one. Esc gives up.",
  ellipse: "Drag from one corner of its box to the opposite one. Esc gives up.",
  line: "Drag from one end to the other; the profile of the luminance is under Luminance. Esc gives up.",
}
const NEAR_PX = 9       // how near a click must be to a corner or an edge
const STILL_PX = 4      // a pointer that moves less was a click
const DOUBLE_MS = 400
const LARGEST_PIXEL = 64  // screen pixels that one pixel of the image may get

const figure_view = Bokeh.index.find_one(figure)
const area = figure_view.canvas_view.events_el
let state = JSON.parse(link.state)
const DRAFT = `labcdp draft ${state.image}`
let corners = JSON.parse(sessionStorage.getItem(DRAFT) ?? "[]")  // of a polygon that is being drawn
let gesture = null      // what the pressed pointer does
let waiting = null      // message whose answer is awaited, with its preview
const NEVER = -1e9
let last_click = {time: NEVER, sx: 0, sy: 0}
let place = null        // centre of the view in pixels of the image, and image pixels for a screen pixel
let space = false
let serial = 0

const mode = () => MODES[modes.active]
const drafting = () => mode() == "polygon" && corners.length > 0

function set_mode(name) {
  modes.active = MODES.indexOf(name)
}

function send(message) {
  serial += 1
  link.sent = JSON.stringify({...message, serial})
  return serial
}

// ---- what is seen

function frame() {
  const {left, top, width, height} = figure_view.frame.bbox
  return {left, top, width, height}
}

function fit_scale() {
  const {width, height} = frame()
  return Math.max(state.width / width, state.height / height) * 1.02
}

function look(new_place, fitted = false) {
  const {width, height} = frame()
  if (width < 2 || height < 2)
    return
  const scale = Math.min(Math.max(new_place.scale, 1 / LARGEST_PIXEL), 2 * fit_scale())
  const cx = Math.min(Math.max(new_place.cx, 0), state.width)
  const cy = Math.min(Math.max(new_place.cy, 0), state.height)
  const before = place?.scale
  place = {cx, cy, scale, fitted}
  figure.x_range.setv({start: cx - scale * width / 2, end: cx + scale * width / 2})
  figure.y_range.setv({start: cy + scale * height / 2, end: cy - scale * height / 2})
  if (scale != before)
    name_shapes()
  ask_for_pixels()
}

function fit() {
  look({cx: state.width / 2, cy: state.height / 2, scale: fit_scale()}, true)
}

function zoom(factor, at = null) {
  const {cx, cy, scale} = place
  const target = Math.min(Math.max(scale * factor, 1 / LARGEST_PIXEL), 2 * fit_scale())
  const fixed = at ?? [cx, cy]
  const share = target / scale
  look({cx: fixed[0] + (cx - fixed[0]) * share, cy: fixed[1] + (cy - fixed[1]) * share, scale: target})
}

let asking = null
function ask_for_pixels() {
  clearTimeout(asking)
  asking = setTimeout(() => {
    const {width, height} = frame()
    const ratio = window.devicePixelRatio || 1
    link.view = [figure.x_range.start, figure.y_range.end, figure.x_range.end, figure.y_range.start,
      Math.round(width * ratio), Math.round(height * ratio)]
  }, 80)
}

function at_pointer(event) {
  const box = area.getBoundingClientRect()
  const [sx, sy] = [event.clientX - box.left, event.clientY - box.top]
  const {left, top, width, height} = frame()
  return {
    sx, sy,
    x: place.cx + (sx - left - width / 2) * place.scale,
    y: place.cy + (sy - top - height / 2) * place.scale,
    in_frame: sx >= left && sx <= left + width && sy >= top && sy <= top + height,
  }
}

const distance_px = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]) / place.scale
const inside_image = ([x, y]) => [Math.min(Math.max(x, 0), state.width), Math.min(Math.max(y, 0), state.height)]

// ---- drawing

function box_corners([xa, ya], [xb, yb]) {
  return [[xa, ya], [xb, ya], [xb, yb], [xa, yb]]
}

function ellipse_corners([xa, ya], [xb, yb]) {
  const points = []
  for (let i = 0; i < 64; i++) {
    const angle = 2 * Math.PI * i / 64
    points.push([(xa + xb) / 2 + Math.abs(xb - xa) / 2 * Math.cos(angle),
      (ya + yb) / 2 + Math.abs(yb - ya) / 2 * Math.sin(angle)])
  }
  return points
}

function selected() {
  return state.shapes.find((shape) => shape.name == state.selected) ?? null
}

// Corners of a shape while one of them, or all of it, is dragged.
function dragged(shape, what, at, to) {
  if (what == "move")
    return shape.handles.map(([x, y]) => [x + to[0], y + to[1]])
  if (shape.kind == "polygon")
    return shape.handles.map((corner, i) => i == at ? to : corner)
  const opposite = shape.handles[(at + 2) % 4]
  const angle = shape.angle * Math.PI / 180
  const [c, s] = [Math.cos(angle), Math.sin(angle)]
  const across = [c * (to[0] - opposite[0]) + s * (to[1] - opposite[1]),
    -s * (to[0] - opposite[0]) + c * (to[1] - opposite[1])]
  const back = (u, v) => [opposite[0] + c * u - s * v, opposite[1] + s * u + c * v]
  return [[0, 0], [across[0], 0], across, [0, across[1]]].map(([u, v]) => back(u, v))
}

// Names at the upper left corners; one that would cover another appears when the picture is enlarged.
const pen = document.createElement("canvas").getContext("2d")
pen.font = "12px helvetica"
function name_shapes() {
  const rows = {x: [], y: [], text: [], colour: []}
  const taken = []
  const rank = (shape) => shape.name == state.selected ? 0 : shape.paired ? 1 : 2
  for (const shape of state.shapes.filter((one) => one.label != "").sort((a, b) => rank(a) - rank(b))) {
    const x = Math.min(...shape.handles.map((corner) => corner[0]))
    const y = Math.min(...shape.handles.map((corner) => corner[1]))
    const [left, top] = [x / place.scale, y / place.scale]
    const box = {left, right: left + pen.measureText(shape.label).width + 8, top, bottom: top + 20}
    if (taken.some((one) => one.left < box.right && box.left < one.right && one.top < box.bottom && box.top < one.bottom))
      continue
    taken.push(box)
    rows.x.push(x)
    rows.y.push(y)
    rows.text.push(shape.label)
    rows.colour.push(shape.label_colour)
  }
  labels.data = rows
}

function redraw() {
  const chosen = selected()
  const rows = {xs: [], ys: [], colour: [], dash: [], width: [], casing: [], fill: []}
  for (const shape of state.shapes) {
    const changing = gesture?.shape === shape || waiting?.shape === shape.name
    shape.outlines.forEach((outline, at) => {
      rows.xs.push(outline.map((corner) => corner[0]))
      rows.ys.push(outline.map((corner) => corner[1]))
      rows.colour.push(shape.colours[at])
      rows.dash.push(shape.proposal ? "dashed" : "solid")
      const width = shape === chosen ? 2.5 : 1.5
      rows.width.push(width)
      rows.casing.push(width + 2.5)
      rows.fill.push(changing ? 0 : shape === chosen ? 0.25 : shape.proposal ? 0.05 : 0.12)
    })
  }
  shapes.data = rows
  let preview = null
  if (gesture?.preview != null)
    preview = {line: gesture.preview, dots: []}
  else if (waiting?.preview != null)
    preview = {line: waiting.preview, dots: []}
  if (drafting())
    preview = {line: gesture?.hover == null ? corners : [...corners, gesture.hover], dots: corners}
  draft.data = {x: (preview?.line ?? []).map((c) => c[0]), y: (preview?.line ?? []).map((c) => c[1])}
  sessionStorage.setItem(DRAFT, JSON.stringify(corners))
  const shown = drafting() ? corners : chosen != null && preview == null ? chosen.handles : []
  handles.data = {x: shown.map((c) => c[0]), y: shown.map((c) => c[1])}
  if (place != null)
    name_shapes()
}

function give_up() {
  corners = []
  gesture = null
  redraw()
}

function take_back() {
  corners.pop()
  last_click.time = NEVER
  redraw()
}

function close_polygon() {
  if (corners.length < 3) {
    hint.text = "A polygon has at least 3 corners: click more of them."
    return
  }
  waiting = {serial: send({do: "polygon", corners}), draws: "polygon"}
}
