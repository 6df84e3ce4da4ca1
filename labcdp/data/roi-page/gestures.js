// Mouse and keys on the picture, and what labcdp answers; picture.js comes before.
//
// Bokeh's own drawing tools begin and end polygons with a long press, and rectangles have no corners to drag: therefore
// the pointer is handled here, and Bokeh draws.

// ---- what is under the pointer

function handle_near(point) {
  const shape = selected()
  if (shape == null || drafting())
    return null
  let best = null
  shape.handles.forEach((corner, at) => {
    const away = distance_px(corner, [point.x, point.y])
    if (away <= NEAR_PX && (best == null || away < best.away))
      best = {shape, at, away}
  })
  return best
}

function edge_near(shape, point) {
  let best = null
  shape.handles.forEach((a, at) => {
    const b = shape.handles[(at + 1) % shape.handles.length]
    const [dx, dy] = [b[0] - a[0], b[1] - a[1]]
    const length = dx * dx + dy * dy
    const t = length == 0 ? 0 : Math.min(Math.max(((point.x - a[0]) * dx + (point.y - a[1]) * dy) / length, 0), 1)
    const foot = [a[0] + t * dx, a[1] + t * dy]
    const away = distance_px(foot, [point.x, point.y])
    if (away <= NEAR_PX && (best == null || away < best.away))
      best = {after: at, foot, away}
  })
  return best
}

function contains(outline, {x, y}) {
  let inside = false
  for (let i = 0, j = outline.length - 1; i < outline.length; j = i++) {
    const [xa, ya] = outline[i]
    const [xb, yb] = outline[j]
    if ((ya > y) != (yb > y) && x < xa + (y - ya) * (xb - xa) / (yb - ya))
      inside = !inside
  }
  return inside
}

function extent(outline) {
  let sum = 0
  for (let i = 0, j = outline.length - 1; i < outline.length; j = i++)
    sum += outline[j][0] * outline[i][1] - outline[i][0] * outline[j][1]
  return Math.abs(sum) / 2
}

// The smallest shape that holds a place: one inside another can be reached.
function shape_under(point) {
  let best = null
  for (const shape of state.shapes)
    for (const outline of shape.outlines)
      if (contains(outline, point) && (best == null || extent(outline) < best.size))
        best = {shape, size: extent(outline)}
  return best?.shape ?? null
}

// ---- pointer

function pressed(event) {
  const point = at_pointer(event)
  if (!point.in_frame || place == null)
    return
  event.stopImmediatePropagation()
  event.preventDefault()
  document.activeElement?.blur?.()
  if (gesture?.pressed)
    return
  if (event.button == 2) {
    if (drafting())
      close_polygon()
    return
  }
  if (waiting?.draws == "polygon")
    return
  // On a slow line a person may go on before the answer; the state comes all the same.
  waiting = null
  try {
    area.setPointerCapture(event.pointerId)
  } catch {
    // Without capture a drag ends at the edge of the picture.
  }
  const start = {pressed: true, from: point, view: {...place}, moved: false}
  const near = handle_near(point)
  if (event.button == 1 || space)
    gesture = {...start, kind: "pan"}
  else if (near != null)
    gesture = {...start, kind: "corner", shape: near.shape, at: near.at, alt: event.altKey}
  else if (mode() == "rectangle" || mode() == "ellipse" || mode() == "line")
    gesture = {...start, kind: "box", form: mode()}
  else if (mode() == "select" && selected() != null && selected().outlines.some((o) => contains(o, point)))
    gesture = {...start, kind: "move", shape: selected()}
  else
    gesture = {...start, kind: "pan"}
}

function moved(event) {
  if (place == null)
    return
  const point = at_pointer(event)
  tell_pointer(point)
  if (gesture?.pressed) {
    event.stopImmediatePropagation()
    gesture.moved ||= Math.hypot(point.sx - gesture.from.sx, point.sy - gesture.from.sy) > STILL_PX
    if (gesture.moved)
      drag(point)
    return
  }
  if (drafting()) {
    gesture = {hover: inside_image([point.x, point.y])}
    redraw()
  }
  area.style.cursor = !point.in_frame ? "default" : handle_near(point) != null ? "grab"
    : mode() == "select" ? (shape_under(point) != null ? "pointer" : "default") : "crosshair"
}

function drag(point) {
  const {from, view} = gesture
  const to = [point.x, point.y]
  if (gesture.kind == "pan") {
    look({cx: view.cx - (point.sx - from.sx) * view.scale, cy: view.cy - (point.sy - from.sy) * view.scale,
      scale: view.scale})
    area.style.cursor = "grabbing"
    return
  }
  let line = null
  if (gesture.kind == "box") {
    const [a, b] = [inside_image([from.x, from.y]), inside_image(to)]
    line = gesture.form == "ellipse" ? ellipse_corners(a, b) : gesture.form == "line" ? [a, b] : box_corners(a, b)
  } else if (gesture.kind == "corner") {
    line = dragged(gesture.shape, "corner", gesture.at, inside_image(to))
  } else {
    line = dragged(gesture.shape, "move", 0, [to[0] - from.x, to[1] - from.y])
  }
  gesture.preview = [...line, line[0]]
  redraw()
}

function released(event) {
  if (!gesture?.pressed)
    return
  event.stopImmediatePropagation()
  const point = at_pointer(event)
  const done = gesture
  gesture = null
  if (done.moved)
    dropped(done, point)
  else
    clicked(done, point, event)
  redraw()
}

function dropped(done, point) {
  const keep = {preview: done.preview, shape: done.shape?.name}
  if (done.kind == "box" && done.form == "line")
    link.line = [done.from.x, done.from.y, point.x, point.y]
  else if (done.kind == "box")
    waiting = {...keep, draws: done.form,
      serial: send({do: "box", kind: done.form, start: [done.from.x, done.from.y], end: [point.x, point.y]})}
  else if (done.kind == "corner")
    waiting = {...keep, serial: send({do: "corner", name: done.shape.name, at: done.at, to: [point.x, point.y]})}
  else if (done.kind == "move")
    waiting = {...keep,
      serial: send({do: "move", name: done.shape.name, by: [point.x - done.from.x, point.y - done.from.y]})}
}

function clicked(done, point, event) {
  const now = performance.now()
  const twice = now - last_click.time < DOUBLE_MS
    && Math.hypot(point.sx - last_click.sx, point.sy - last_click.sy) <= STILL_PX
  last_click = {time: twice ? NEVER : now, sx: point.sx, sy: point.sy}
  if (event.button != 0)
    return
  if (done.kind == "corner") {
    if (done.alt)
      send({do: "remove corner", name: done.shape.name, at: done.at})
    return
  }
  if (mode() == "polygon") {
    const to = inside_image([point.x, point.y])
    if (corners.length >= 3 && (twice || distance_px(corners[0], to) <= NEAR_PX))
      close_polygon()
    else if (!twice)
      corners.push(to)
    return
  }
  if (mode() != "select")
    return
  const shape = selected()
  const edge = shape?.kind == "polygon" ? edge_near(shape, point) : null
  if (edge == null)
    send({do: "select", name: shape_under(point)?.name ?? null})
  else if (twice)
    send({do: "insert", name: shape.name, after: edge.after, at: [point.x, point.y]})
}

let telling = null
let told = ""
let pointer = null
function tell_pointer(point) {
  const x = Math.floor(point.x)
  const y = Math.floor(point.y)
  const inside = point.in_frame && x >= 0 && y >= 0 && x < state.width && y < state.height
  pointer = inside ? [x, y] : []
  if (telling == null && pointer.join() != told) {
    told = pointer.join()
    link.pointer = pointer
    // One at a time: a slow line must not be filled with places the pointer has left.
    telling = setTimeout(() => {
      telling = null
      if (pointer.join() != told) {
        told = pointer.join()
        link.pointer = pointer
      }
    }, 40)
  }
}

function left() {
  if (gesture?.pressed)
    return
  told = ""
  pointer = []
  link.pointer = []
  if (drafting()) {
    gesture = null
    redraw()
  }
}

function wheel(event) {
  const point = at_pointer(event)
  if (!point.in_frame || place == null)
    return
  event.stopImmediatePropagation()
  event.preventDefault()
  const lines = event.deltaMode == 1 ? 30 : event.deltaMode == 2 ? 300 : 1
  zoom(Math.exp(Math.min(Math.max(event.deltaY * lines, -200), 200) * 0.002), [point.x, point.y])
}

// ---- keys

const ARROWS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1]}

// Arrows move the selected region by a pixel (Shift: ten), with Alt its lower right corner; without one, the picture.
function arrow(name, event) {
  const [dx, dy] = ARROWS[name].map((one) => one * (event.shiftKey ? 10 : 1))
  const shape = selected()
  if (shape == null)
    return () => look({...place, cx: place.cx + 20 * dx * place.scale, cy: place.cy + 20 * dy * place.scale})
  const [x, y] = shape.handles[Math.min(2, shape.handles.length - 1)]
  return () => send(event.altKey ? {do: "corner", name: shape.name, at: 2, to: [x + dx, y + dy]}
    : {do: "move", name: shape.name, by: [dx, dy]})
}

function new_box() {
  const {width, height} = frame()
  const [w, h] = [width * place.scale / 16, height * place.scale / 16]
  send({do: "box", kind: "rectangle", start: [place.cx - w, place.cy - h], end: [place.cx + w, place.cy + h]})
}

function select_next(step) {
  const names = state.shapes.map((shape) => shape.name)
  const at = names.indexOf(state.selected)
  if (names.length > 0)
    send({do: "select", name: names[(at < 0 && step < 0 ? names.length - 1 : at + step + names.length) % names.length]})
}

function show_tab(number) {
  const models = figure.document.roots().flatMap((root) => [...root.references()])
  const tabs = models.find((model) => model.type.endsWith("Tabs"))
  if (tabs != null && number <= tabs.tabs.length)
    tabs.active = number - 1
}

function key(event) {
  const target = event.composedPath()[0]
  const command = event.ctrlKey || event.metaKey
  const name = event.key.length == 1 ? event.key.toLowerCase() : event.key
  const typing = target instanceof HTMLElement && ["INPUT", "TEXTAREA", "SELECT"].includes(target.tagName)
  if (typing && !(command && name == "s"))
    return
  const act = () => {
    if (command && name == "z" && drafting())
      return take_back
    if (command && name == "z")
      return () => send({do: event.shiftKey ? "redo" : "undo"})
    if (command && name == "y")
      return () => send({do: "redo"})
    if (command && name == "s")
      return () => send({do: "save"})
    if (name in ARROWS && !command && place != null)
      return arrow(name, event)
    if (command || event.altKey)
      return null
    if (/^[1-9]$/.test(name))
      return () => show_tab(Number(name))
    const by_key = {
      v: () => set_mode("select"),
      p: () => set_mode("polygon"),
      r: () => set_mode("rectangle"),
      e: () => set_mode("ellipse"),
      l: () => set_mode("line"),
      f: fit,
      n: new_box,
      "[": () => select_next(-1),
      "]": () => select_next(1),
      "+": () => zoom(1 / 1.5),
      "-": () => zoom(1.5),
      " ": () => { space = true },
      Escape: () => drafting() || gesture?.pressed ? give_up() : set_mode("select"),
    }
    if (name == "Enter" && drafting())
      return close_polygon
    if (name == "Enter" && selected()?.proposal)
      return () => send({do: "accept", name: state.selected})
    if (name == "Backspace" && drafting())
      return take_back
    if ((name == "Delete" || name == "Backspace") && state.selected != null)
      return () => send({do: "delete", name: state.selected})
    return by_key[name] ?? null
  }
  const action = act()
  // A focused button is pressed by Enter and the space bar.
  if (action == null || (target?.tagName == "BUTTON" && (name == "Enter" || name == " ")))
    return
  event.preventDefault()
  action()
}

// ---- from labcdp

link.properties.state.change.connect(() => {
  const {width, height} = state
  state = JSON.parse(link.state)
  if (state.width != width || state.height != height)
    fit()
  redraw()
})
link.properties.answers.change.connect(() => {
  const done = JSON.parse(link.answers)[waiting?.serial]
  if (done == null)
    return
  const {draws} = waiting
  waiting = null
  if (done && draws == "polygon")
    corners = []
  if (done && draws != null)
    set_mode("select")
  redraw()
})
link.properties.ask.change.connect(() => {
  const [what] = link.ask.split(" ")
  if (what == "fit")
    fit()
  else if (what == "in")
    zoom(1 / 1.5)
  else if (what == "out")
    zoom(1.5)
})
modes.properties.active.change.connect(() => {
  hint.text = HINTS[mode()]
  gesture = null
  redraw()
})

area.addEventListener("pointerdown", pressed, {capture: true})
area.addEventListener("pointermove", moved, {capture: true})
area.addEventListener("pointerup", released, {capture: true})
area.addEventListener("pointercancel", () => { gesture = null; redraw() }, {capture: true})
area.addEventListener("pointerleave", left, {capture: true})
area.addEventListener("wheel", wheel, {capture: true, passive: false})
area.addEventListener("contextmenu", (event) => event.preventDefault())
document.addEventListener("keydown", key)
document.addEventListener("keyup", (event) => { if (event.key == " ") space = false })
// A row of the table of regions selects one.
document.addEventListener("click", (event) => {
  const asking = event.composedPath().find((element) => element.dataset?.message != null)
  if (asking != null)
    send(JSON.parse(asking.dataset.message))
  const row = event.composedPath().find((element) => element.dataset?.region != null)
  if (row != null)
    send({do: "select", name: row.dataset.region})
})

// ---- the connection to labcdp

const lost = document.createElement("div")
lost.setAttribute("role", "alert")
lost.textContent = "labcdp cannot be reached: it has ended, or the connection was lost. What you drew is saved."
  + " This page reconnects by itself. If labcdp has ended, start it again and open its new address."
lost.style.cssText = "position: fixed; inset: 0 0 auto 0; z-index: 1000; padding: 0.6rem 1rem; background: #fff4e8;"
  + " border-bottom: 3px solid #b34700; font: 600 15px sans-serif; color: #1a1a1a;"
let looking = null
figure.document.on_event("connection_lost", () => {
  document.body.append(lost)
  // This page missed what changed meanwhile, and after a long sleep labcdp has forgotten it: load a new one.
  looking ??= setInterval(async () => {
    const answer = await fetch("static/js/bokeh.min.js", {method: "HEAD", cache: "no-store"}).catch(() => null)
    if (answer?.ok)
      location.reload()
  }, 2000)
})
// labcdp waits with the next refresh until the one before was handled, so that none pile up for a browser that sleeps.
link.n_handled = link.n_refreshes
link.properties.n_refreshes.change.connect(() => link.n_handled = link.n_refreshes)

const TAB = "labcdp tab"
sessionStorage.setItem(TAB, sessionStorage.getItem(TAB) ?? Math.random().toString(36).slice(2))
link.tab = sessionStorage.getItem(TAB)

let seen = ""
function resized() {
  const {width, height} = frame()
  if (`${width} ${height}` == seen || width < 2 || height < 2)
    return
  seen = `${width} ${height}`
  if (place == null || place.fitted)
    fit()
  else
    look(place)
}
figure.properties.inner_width.change.connect(() => setTimeout(resized))
figure.properties.inner_height.change.connect(() => setTimeout(resized))
if (corners.length > 0)
  set_mode("polygon")
hint.text = HINTS[mode()]
resized()
redraw()
