// The viewer in an element: draws pictures that are sent, and says what its user does. Nothing is computed here.
import { overlay } from './overlay.js'
import { panel } from './panel.js'

const KEYS = ['r', 'v', 'w', 's', 'b', 'f', '+', '-', '=', 'C', 'ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown']
const LABEL = 'Picture of the volume. Arrow keys turn it, with shift they move it, plus and minus zoom, question mark ' +
  'lists all keys.'
// A wheel's notch, and by how much a notch zooms: those of the server.
const NOTCH = 100
const ZOOM = 1.21

// An element, its attributes and children; text goes in as text.
function make (tag, attributes = {}, ...children) {
  const element = document.createElement(tag)
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value)
    else if (value === true) element.setAttribute(name, '')
    else if (value !== false && value !== null) element.setAttribute(name, value)
  }
  element.append(...children)
  return element
}

function modifiers (event) {
  return ['Alt', 'Control', 'Meta', 'Shift'].filter((name) => event.getModifierState(name))
}

// The newest message of a kind is sent with the next frame of the screen; kinds keep their order.
function paced (send) {
  const waiting = new Map()
  let asked = false
  const flush = () => {
    asked = false
    const messages = [...waiting.values()]
    waiting.clear()
    messages.forEach(send)
  }
  return {
    put (kind, message) {
      waiting.delete(kind)
      waiting.set(kind, message)
      if (!asked) {
        asked = true
        // A hidden page has no frames, but may be told things.
        if (document.hidden) window.setTimeout(flush, 16)
        else window.requestAnimationFrame(flush)
      }
    },
    get: (kind) => waiting.get(kind),
    flush
  }
}

// Pointer, wheel and keys of an element, as events of rendercanvas.
function listen (canvas, send, { screenshot, help, handles }) {
  const pace = paced(send)
  const down = new Map()
  let spread = 0
  const place = (event) => {
    const box = canvas.getBoundingClientRect()
    return { x: event.clientX - box.left, y: event.clientY - box.top }
  }
  const say = (type, event, button) => ({ type, ...place(event), button, modifiers: modifiers(event) })
  const zoom = (dy, at) => {
    const before = pace.get('wheel')
    pace.put('wheel', { type: 'wheel', ...at, dx: 0, dy: dy + (before === undefined ? 0 : before.dy) })
  }
  const distance = () => {
    const [a, b] = [...down.values()]
    return Math.hypot(a.x - b.x, a.y - b.y)
  }
  canvas.addEventListener('pointerdown', (event) => {
    canvas.focus({ preventScroll: true })
    canvas.setPointerCapture(event.pointerId)
    down.set(event.pointerId, place(event))
    if (down.size === 1) send(say('pointer_down', event, [1, 3, 2][event.button] ?? 4))
    else if (down.size === 2) {
      send(say('pointer_up', event, 0))
      spread = distance()
    }
    event.preventDefault()
  })
  canvas.addEventListener('pointermove', (event) => {
    if (down.has(event.pointerId)) down.set(event.pointerId, place(event))
    if (down.size === 2) {
      const now = distance()
      zoom(-NOTCH / 2 * Math.log(now / spread) / Math.log(Math.sqrt(ZOOM)), place(event))
      spread = now
    } else pace.put('move', say('pointer_move', event, 0))
  })
  const up = (event) => {
    if (!down.delete(event.pointerId)) return
    pace.flush()
    send(say('pointer_up', event, 0))
  }
  canvas.addEventListener('pointerup', up)
  canvas.addEventListener('pointercancel', up)
  canvas.addEventListener('pointerleave', () => pace.flush())
  canvas.addEventListener('contextmenu', (event) => event.preventDefault())
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault()
    zoom(event.deltaY * [1, 16, 600][event.deltaMode], place(event))
  }, { passive: false })
  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return
    if (event.key === 'S') screenshot()
    else if (event.key === '?') help()
    else if (event.key === 'h') handles.click()
    else if (KEYS.includes(event.key)) {
      const at = canvas.matches(':hover') ? canvas.under : undefined
      send({ type: 'key_down', key: event.key, modifiers: modifiers(event), ...at })
      event.preventDefault()
    }
  })
  canvas.addEventListener('pointermove', (event) => { canvas.under = place(event) })
}

// In `root`; `send` takes messages. Returns what a connection calls.
export function start (root, send) {
  const canvas = make('canvas', { tabindex: 0, role: 'application', 'aria-label': LABEL, class: 'wvr-picture' })
  const context = canvas.getContext('2d')
  const status = make('span', { class: 'wvr-status', 'aria-hidden': 'true' }, 'Connecting …')
  const spoken = make('span', { class: 'wvr-spoken', role: 'status' })
  const under = make('span', { class: 'wvr-under' })
  const problem = make('p', { class: 'wvr-problem', role: 'alert', hidden: true })
  const handles = overlay(send, paced(send))
  const stage = make('div', { class: 'wvr-stage' }, canvas, handles.element, problem)
  const line = make('div', { class: 'wvr-line' }, status, under, spoken)
  let arrived = 0
  let drawn = 0
  let known = null
  let camera = null
  let last = null

  const screenshot = () => { if (last !== null) download(last, 'wvr.png') }
  const side = panel(make, send, paced(send), {
    screenshot, download, focus: () => canvas.focus(), showHandles: handles.show
  })
  root.classList.add('wvr-viewer')
  root.replaceChildren(make('div', { class: 'wvr-main' }, stage, line), side.element)
  listen(canvas, send, { screenshot, help: side.help, handles: side.handles })
  handles.element.addEventListener('wheel', (event) => {
    event.preventDefault()
    canvas.dispatchEvent(new WheelEvent('wheel', event))
  }, { passive: false })
  root.addEventListener('keydown', (event) => {
    const control = (event.ctrlKey || event.metaKey) && !event.altKey
    if (!control || event.key.toLowerCase() !== 'z' || event.target.matches('input[type="number"], textarea')) return
    send({ type: event.shiftKey ? 'redo' : 'undo' })
    event.preventDefault()
  })

  function download (blob, name) {
    const link = make('a', { href: URL.createObjectURL(blob), download: name })
    link.click()
    window.setTimeout(() => URL.revokeObjectURL(link.href), 1000)
  }

  function resized () {
    const ratio = window.devicePixelRatio
    const { width, height } = stage.getBoundingClientRect()
    if (width >= 1 && height >= 1) {
      send({ type: 'resize', width: Math.floor(width), height: Math.floor(height), pixel_ratio: ratio })
    }
  }

  function complain (text) {
    problem.hidden = text === ''
    problem.textContent = text
  }

  async function draw (message, blob) {
    const turn = ++arrived
    const bitmap = await createImageBitmap(blob, { colorSpaceConversion: 'none', premultiplyAlpha: 'none' })
    if (turn > drawn) { // one that was decoded sooner is newer
      drawn = turn
      canvas.classList.remove('wvr-still')
      const [width, height] = message.size
      if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height })
      context.drawImage(bitmap, 0, 0, width, height)
      handles.draw(message.overlay)
      last = blob
      camera = message.camera
      status.textContent = message.status
      status.classList.toggle('wvr-met', message.met)
      if (message.whole) spoken.textContent = message.status
      complain('')
      root.dispatchEvent(new CustomEvent('wvr-picture', { detail: message }))
    }
    bitmap.close()
    send({ type: 'seen' })
  }

  const handlers = {
    picture: draw,
    state (message) {
      known = message
      side.state(message)
    },
    source (message) {
      document.body.classList.contains('wvr-page') && (document.title = `${message.title} – wvr`)
      side.source(message)
    },
    picked (message) {
      const number = (x) => Number(x.toPrecision(4))
      under.textContent = message.position === undefined
        ? ''
        : `${number(message.value)} at (${message.position.map(number).join(', ')})`
    },
    text: (message) => side.text(message.title, message.text),
    error: (message) => complain(message.message)
  }
  new ResizeObserver(resized).observe(stage)

  // A picture that is there without anybody who could answer.
  async function still (address) {
    const image = new Image()
    image.src = address
    await image.decode()
    if (drawn > 0) return
    Object.assign(canvas, { width: image.naturalWidth, height: image.naturalHeight })
    canvas.classList.add('wvr-still')
    context.drawImage(image, 0, 0)
    status.textContent = 'A picture of the volume; it moves where there is a kernel.'
  }

  return {
    still,
    receive: (message, blob) => handlers[message.type]?.(message, blob),
    connected () {
      complain('')
      if (drawn === 0) status.textContent = 'Waiting for the first picture …'
      resized()
      // What this page showed before: the server may be another one by now.
      if (known !== null) send({ type: 'restore', state: camera === null ? known : { ...known, camera } })
      root.classList.remove('wvr-lost')
    },
    disconnected (reason) {
      root.classList.add('wvr-lost')
      complain(`No connection${reason ? `: ${reason}` : ''}. Trying again …`)
    }
  }
}
