// The editor of a transfer function: its control points over the histogram. Edits are sent; what comes back is drawn.

const SPACE = 'http://www.w3.org/2000/svg'
const WIDTH = 300
const HEIGHT = 140
const EDGE = 8
// Opacities of a voxel are mostly small: the axis is their cube root.
const TICKS = [0.001, 0.01, 0.1, 0.3, 1]
// Between two control points, so many places of the curve: opacity is not linear there, extinction is.
const PARTS = 12

export function svg (tag, attributes, ...children) {
  const element = document.createElementNS(SPACE, tag)
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value)
  element.append(...children)
  return element
}

const rounded = (x) => String(Number(Number(x).toPrecision(6)))

export function editor (make, send, pace) {
  let points = []
  let span = [0, 1]
  let unit = ''
  let chosen = 0
  let drag = 0
  let held = null

  const toX = (scalar) => EDGE + (WIDTH - 2 * EDGE) * (scalar - span[0]) / (span[1] - span[0])
  const toY = (opacity) => HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * Math.cbrt(opacity)
  const scalarAt = (x) => span[0] + (x - EDGE) / (WIDTH - 2 * EDGE) * (span[1] - span[0])
  const opacityAt = (y) => Math.min(Math.max((HEIGHT - EDGE - y) / (HEIGHT - 2 * EDGE), 0), 1) ** 3

  const name = `wvr-colors-${Math.random().toString(36).slice(2)}`
  const gradient = svg('linearGradient', { id: name, gradientUnits: 'userSpaceOnUse', y1: 0, y2: 0 })
  const bars = svg('path', { class: 'wvr-bars' })
  const area = svg('path', { fill: `url(#${name})`, class: 'wvr-area' })
  const curve = svg('path', { class: 'wvr-curve' })
  const axis = svg('g', { class: 'wvr-axis', 'aria-hidden': 'true' })
  const handles = svg('g', {})
  const plot = svg('svg', {
    viewBox: `0 0 ${WIDTH} ${HEIGHT}`, class: 'wvr-plot', role: 'group', 'aria-label': 'Control points over the histogram'
  }, svg('defs', {}, gradient), bars, area, axis, curve, handles)

  const field = (label, type, attributes) => {
    const input = make('input', { type, ...attributes })
    return [make('label', {}, label, input), input]
  }
  const [scalarField, scalarInput] = field('Scalar', 'number', { step: 'any', onchange: () => typed() })
  const [opacityField, opacityInput] = field('Opacity', 'number', { step: 'any', min: 0, max: 1, onchange: () => typed() })
  const [colorField, colorInput] = field('Colour', 'color', {
    oninput: () => pace.put('color', { type: 'edit', op: 'color', index: chosen, color: colorInput.value, drag: `color ${drag}` }),
    onchange: () => { drag++ }
  })
  const note = make('p', { class: 'wvr-note' })
  const remove = make('button', { type: 'button', onclick: () => removed() }, 'Remove')
  const add = make('button', { type: 'button', onclick: () => added() }, 'Add')
  const element = make('div', { class: 'wvr-editor' }, plot,
    make('div', { class: 'wvr-fields' }, scalarField, opacityField, colorField),
    make('div', { class: 'wvr-buttons' }, add, remove), note)

  const move = (scalar, opacity, tag) => {
    pace.put('move', { type: 'edit', op: 'move', index: chosen, scalar, opacity, drag: tag })
  }
  function typed () {
    move(Number(scalarInput.value), Number(opacityInput.value), `typed ${drag++}`)
  }
  function removed () {
    if (points.length > 2) send({ type: 'edit', op: 'remove', index: chosen })
    choose(Math.max(chosen - 1, 0))
  }
  function added () {
    // Half-way to the next point; the curve stays as it is.
    const next = chosen + 1 < points.length ? chosen + 1 : chosen - 1
    const scalar = (points[chosen][0] + points[next][0]) / 2
    const index = Math.max(chosen, next)
    send({ type: 'edit', op: 'add', scalar })
    chosen = index
  }
  function choose (index) {
    chosen = Math.min(index, points.length - 1)
    fill()
  }

  function place (event) {
    const box = plot.getBoundingClientRect()
    return [(event.clientX - box.left) * WIDTH / box.width, (event.clientY - box.top) * HEIGHT / box.height]
  }
  plot.addEventListener('dblclick', (event) => {
    if (event.target.closest('circle') !== null) return
    const [x, y] = place(event)
    const scalar = scalarAt(x)
    const index = points.filter((point) => point[0] < scalar).length
    send({ type: 'edit', op: 'add', scalar, opacity: opacityAt(y) })
    chosen = index
  })
  plot.addEventListener('pointerdown', (event) => {
    const handle = event.target.closest('circle')
    if (handle === null) return
    choose(Number(handle.dataset.index))
    held = { grab: place(event), from: [toX(points[chosen][0]), toY(points[chosen][2])] }
    drag++
    plot.setPointerCapture(event.pointerId)
    handle.focus()
    event.preventDefault()
  })
  plot.addEventListener('pointermove', (event) => {
    if (held === null) return
    const [x, y] = place(event)
    move(scalarAt(held.from[0] + x - held.grab[0]), opacityAt(held.from[1] + y - held.grab[1]), `drag ${drag}`)
  })
  for (const end of ['pointerup', 'pointercancel']) plot.addEventListener(end, () => { held = null })

  handles.addEventListener('focusin', (event) => choose(Number(event.target.dataset.index)))
  handles.addEventListener('keydown', (event) => {
    const [scalar, , opacity] = points[chosen]
    const fine = event.shiftKey ? 0.1 : 1
    const across = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0
    const up = { ArrowDown: -1, ArrowUp: 1 }[event.key] ?? 0
    if (across !== 0 || up !== 0) {
      const height = Math.min(Math.max(Math.cbrt(opacity) + 0.02 * fine * up, 0), 1)
      move(scalar + fine * across * (span[1] - span[0]) / 100, up === 0 ? opacity : height ** 3, `keys ${chosen}`)
    } else if (event.key === 'Delete') removed()
    else return
    event.preventDefault()
  })

  function fill () {
    const point = points[chosen]
    if (point === undefined) return
    const inputs = [[scalarInput, rounded(point[0])], [opacityInput, rounded(point[2])], [colorInput, point[1]]]
    for (const [input, value] of inputs) if (document.activeElement !== input || input === colorInput) input.value = value
    note.textContent = `Point ${chosen + 1} of ${points.length}. Opacity of a thickness of ${unit}.`
    remove.disabled = points.length <= 2
    ;[...handles.children].forEach((handle, index) => handle.classList.toggle('wvr-chosen', index === chosen))
  }

  function outline () {
    const depth = (opacity) => -Math.log1p(-Math.min(opacity, 0.9999999))
    const line = [[span[0], points[0][2]]]
    points.forEach(([scalar, , opacity], index) => {
      if (index > 0) {
        const [from, , start] = points[index - 1]
        for (let part = 1; part < PARTS; part++) {
          const t = part / PARTS
          line.push([from + t * (scalar - from), -Math.expm1(-(1 - t) * depth(start) - t * depth(opacity))])
        }
      }
      line.push([scalar, opacity])
    })
    line.push([Math.max(span[1], line[line.length - 1][0]), points[points.length - 1][2]])
    return line.map(([scalar, opacity]) => `${toX(scalar).toFixed(2)} ${toY(opacity).toFixed(2)}`).join(' L ')
  }

  function draw () {
    const [start, end] = [points[0][0], points[points.length - 1][0]]
    gradient.setAttribute('x1', toX(start))
    gradient.setAttribute('x2', Math.max(toX(end), toX(start) + 1e-3))
    gradient.replaceChildren(...points.map(([scalar, color]) => svg('stop', {
      offset: end > start ? (scalar - start) / (end - start) : 0, 'stop-color': color
    })))
    const line = outline()
    curve.setAttribute('d', `M ${line}`)
    area.setAttribute('d', `M ${EDGE} ${HEIGHT - EDGE} L ${line} L ${WIDTH - EDGE} ${HEIGHT - EDGE} Z`)
    while (handles.children.length > points.length) handles.lastChild.remove()
    while (handles.children.length < points.length) {
      handles.append(svg('circle', { r: 6, tabindex: 0, role: 'slider', 'data-index': handles.children.length }))
    }
    points.forEach(([scalar, color, opacity], index) => {
      const values = {
        cx: toX(scalar), cy: toY(opacity), fill: color, 'aria-label': `Control point ${index + 1}`, 'aria-valuemin': 0,
        'aria-valuemax': 1, 'aria-valuenow': rounded(opacity),
        'aria-valuetext': `scalar ${rounded(scalar)}, opacity ${rounded(opacity)}, colour ${color}`
      }
      for (const [key, value] of Object.entries(values)) handles.children[index].setAttribute(key, value)
    })
  }

  return {
    element,
    source (message) {
      span = message.span
      unit = `${rounded(message.spacing)}, the smallest voxel spacing`
      const step = (WIDTH - 2 * EDGE) / message.histogram.length
      bars.setAttribute('d', message.histogram.map((height, index) =>
        `M ${EDGE + index * step} ${HEIGHT - EDGE} v ${-height * (HEIGHT - 2 * EDGE)} h ${step} V ${HEIGHT - EDGE}`).join(' '))
      axis.replaceChildren(...TICKS.flatMap((tick) => [
        svg('line', { x1: EDGE, x2: WIDTH - EDGE, y1: toY(tick), y2: toY(tick) }),
        svg('text', { x: EDGE + 1, y: toY(tick) - 1.5 }, String(tick))
      ]), svg('text', { x: EDGE, y: HEIGHT - 0.5 }, rounded(span[0])),
      svg('text', { x: WIDTH - EDGE, y: HEIGHT - 0.5, 'text-anchor': 'end' }, rounded(span[1])))
    },
    state (message) {
      points = message.points
      if (typeof message.unit === 'number') unit = rounded(message.unit)
      if (message.unit === 'pyvista') unit = "PyVista's unit distance"
      draw()
      choose(chosen)
    }
  }
}
