// What is beside the picture: transfer function, clips, light, views, time, and what can be taken home.
import { editor } from './editor.js'

const HELP = [
  ['Drag', 'turn'], ['Shift + drag, or middle button', 'move'], ['Wheel, right button, or two fingers', 'zoom'],
  ['Control + drag', 'spin'], ['Arrows', 'turn; with shift move'], ['+ and -', 'zoom'],
  ['r', 'all that is visible in the frame'], ['v', 'isometric view'],
  ['f', 'turn around what is under the mouse, or in the middle'], ['w and s', 'with and without the edges of the box'],
  ['b', 'the bound on the error of each pixel'], ['h', 'with and without the handles of clips'],
  ['On a handle', 'drag; arrows, page up and down, with shift finer'], ['Control + Z, with shift', 'undo, redo'], ['C', 'the camera in Python'], ['S', 'screenshot']
]
const AXES = [['x', [-1, 0, 0]], ['y', [0, -1, 0]], ['z', [0, 0, -1]]]

export function panel (make, send, pace, { screenshot, download, focus, showHandles }) {
  const setters = []
  let drag = 0
  const button = (text, onclick, attributes = {}) => make('button', { type: 'button', onclick, ...attributes }, text)
  const section = (title, open, ...children) =>
    make('details', { open }, make('summary', {}, title), make('div', { class: 'wvr-section' }, ...children))
  const set = (input, value, property = 'value') => { if (document.activeElement !== input || property !== 'value') input[property] = value }

  function check (text, read, change) {
    const input = make('input', { type: 'checkbox', onchange: () => send(change(input.checked)) })
    setters.push((state) => set(input, read(state), 'checked'))
    return make('label', { class: 'wvr-check' }, input, text)
  }
  function slider (text, range, read, change) {
    const [min, max, step] = range
    const output = make('output')
    const input = make('input', { type: 'range', min, max, step, onchange: () => { drag++ } })
    input.addEventListener('input', () => {
      output.textContent = input.value
      pace.put(text, { ...change(Number(input.value)), drag: `${text} ${drag}` })
    })
    setters.push((state) => {
      set(input, read(state))
      output.textContent = String(Number(Number(input.value).toFixed(2)))
    })
    return make('label', { class: 'wvr-slider' }, make('span', {}, text), input, output)
  }
  function select (text, change) {
    const input = make('select', { onchange: () => { if (input.value !== '') send(change(input.value)); input.value = '' } })
    return [make('label', { class: 'wvr-select' }, text, input), input]
  }
  const choices = (input, first, groups) => {
    input.replaceChildren(make('option', { value: '' }, first), ...groups.map(([label, names]) =>
      make('optgroup', { label }, ...names.map((name) => make('option', { value: name }, name)))))
  }

  // Of transfer functions and clips
  const undo = button('Undo', () => send({ type: 'undo' }))
  const redo = button('Redo', () => send({ type: 'redo' }))
  setters.push((state) => {
    undo.disabled = state.history[0] === 0
    redo.disabled = state.history[1] === 0
  })

  // Transfer function
  const points = editor(make, send, pace)
  const [functions, functionInput] = select('Function', (name) => ({ type: 'edit', op: 'choose', name }))
  let known = null
  const file = make('input', {
    type: 'file',
    accept: '.json',
    hidden: true,
    onchange: async () => {
      if (file.files.length > 0) send({ type: 'edit', op: 'load', text: await file.files[0].text() })
      file.value = ''
    }
  })
  const density = (text, factor, label) =>
    button(text, () => send({ type: 'edit', op: 'density', factor }), { 'aria-label': label })
  const transfer = section('Transfer function', true, points.element,
    make('div', { class: 'wvr-buttons' }, density('Thinner', 1 / 1.25, 'Thinner'), density('Denser', 1.25, 'Denser')),
    functions,
    make('div', { class: 'wvr-buttons' },
      button('Save', () => download(new Blob([known.function], { type: 'application/json' }), 'transfer-function.json')),
      button('Load', () => file.click()), file))
  setters.push((state) => {
    transfer.hidden = state.points === null
    if (state.points !== null) points.state(state)
  })

  // Light
  const lamp = (index) => (value) => {
    const now = [...known.lamp]
    now[index] = value
    known.lamp = now
    return { type: 'light', lamp: now }
  }
  const light = section('Light', true,
    make('div', { class: 'wvr-buttons' },
      check('Light', (state) => state.lighting, (on) => ({ type: 'light', lighting: on })),
      check('Shadows', (state) => state.shadows, (on) => ({ type: 'light', shadows: on }))),
    slider('From the right', [-180, 180, 1], (state) => state.lamp[0], lamp(0)),
    slider('From above', [-90, 90, 1], (state) => state.lamp[1], lamp(1)),
    button('As at first', () => send({ type: 'light', lamp: null })))

  // Clips
  const clip = (kind, name, index) => (value) => {
    let next = value
    if (index !== undefined) {
      next = [...known.clips[kind][name]]
      next[index] = value
      known.clips[kind][name] = next
    }
    return { type: 'clip', kind, set: { [name]: next } }
  }
  const part = [0, 1, 0.005]
  const three = (kind, name, label) => ['x', 'y', 'z'].map((axis, index) =>
    slider(`${label} ${axis}`, part, (state) => state.clips[kind][name][index], clip(kind, name, index)))
  const kind = (name, title, ...children) => make('fieldset', {}, make('legend', {}, title),
    make('div', { class: 'wvr-buttons' },
      check(`Cut by a ${title.toLowerCase()}`, (state) => state.clips[name].on, clip(name, 'on')),
      check('Inverted', (state) => state.clips[name].invert, clip(name, 'invert'))), ...children)
  const handles = make('input', { type: 'checkbox', checked: true, onchange: () => showHandles(handles.checked) })
  const clips = section('Clip', false,
    make('label', { class: 'wvr-check' }, handles, 'Handles in the picture'),
    kind('plane', 'Plane', slider('Plane at', part, (state) => state.clips.plane.at, clip('plane', 'at')),
      make('div', { class: 'wvr-buttons' },
        ...AXES.map(([axis, normal]) => button(`Across ${axis}`, () => send({ type: 'clip', kind: 'plane', set: { normal, on: true } }))),
        button('Facing me', () => send({ type: 'facing' })))),
    kind('box', 'Box', ...three('box', 'lo', 'From'), ...three('box', 'hi', 'To')),
    kind('sphere', 'Sphere', ...three('sphere', 'center', 'Centre'),
      slider('Radius', part, (state) => state.clips.sphere.radius, clip('sphere', 'radius'))))

  // View
  const [views, viewInput] = select('View from', (name) => ({ type: 'view', name }))
  const key = (text, name, label) => button(text, () => { send({ type: 'key_down', key: name, modifiers: [] }) }, { 'aria-label': label })
  const view = section('View', true,
    make('div', { class: 'wvr-buttons' }, key('Reset', 'r', 'Reset the view'), key('+', '+', 'Zoom in'), key('−', '-', 'Zoom out'),
      button('Keys', () => help())),
    views,
    make('div', { class: 'wvr-buttons' },
      check('Parallel', (state) => state.parallel, (on) => ({ type: 'parallel', on })),
      check('Box', (state) => state.outline, (on) => ({ type: 'marks', outline: on })),
      check('Error bound', (state) => state.bound, (on) => ({ type: 'marks', bound: on }))))

  // Time
  const time = make('div', { hidden: true })

  const take = section('Take home', true, make('div', { class: 'wvr-buttons' },
    button('Screenshot', screenshot), button('Copy as Python', () => send({ type: 'script' })),
    button('Camera', () => send({ type: 'camera' }))))

  // Texts, and help
  const title = make('h2')
  const area = make('textarea', { readonly: true, rows: 16, 'aria-label': 'Text' })
  const table = make('table', {}, ...HELP.map(([keys, what]) => make('tr', {}, make('th', { scope: 'row' }, keys), make('td', {}, what))))
  const copy = button('Copy', () => copied())
  const dialog = make('dialog', { onclose: focus }, title, area, table,
    make('div', { class: 'wvr-buttons' }, copy, button('Close', () => dialog.close())))
  async function copied () {
    area.select()
    try {
      await navigator.clipboard.writeText(area.value)
      copy.textContent = 'Copied'
    } catch {
      copy.textContent = 'Press control and C'
    }
  }
  function open (name, text) {
    title.textContent = name
    area.value = text
    area.hidden = copy.hidden = text === ''
    table.hidden = text !== ''
    copy.textContent = 'Copy'
    if (!dialog.open) dialog.showModal()
    area.setSelectionRange(0, 0)
    area.scrollTop = 0
  }
  const help = () => open('Keys and mouse', '')

  const name = make('h1')
  const about = make('p', { class: 'wvr-note' })
  const element = make('aside', { class: 'wvr-panel', 'aria-label': 'Settings' },
    make('header', {}, name, about, make('div', { class: 'wvr-buttons' }, undo, redo)), time, transfer, light, view, clips, take, dialog)

  return {
    element,
    help,
    handles,
    text: open,
    source (message) {
      name.textContent = message.title
      about.textContent = message.about
      points.source(message)
      choices(functionInput, 'Choose …', [['Suggested', message.suggestions], ['Presets', message.presets],
        ['Colours', ['viridis', 'magma', 'inferno', 'plasma', 'cividis', 'gray', 'bone', 'coolwarm', 'turbo']]])
      choices(viewInput, 'Choose …', [['Views', message.views]])
      if (message.frames > 1 && time.hidden) {
        time.hidden = false
        time.append(slider('Time', [0, message.frames - 1, 1], (state) => state.frame, (index) => ({ type: 'frame', index })))
      }
    },
    state (message) {
      known = message
      for (const setter of setters) setter(message)
    }
  }
}
