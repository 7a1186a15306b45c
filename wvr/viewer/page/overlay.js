// Handles of clips over the picture, drawn where they are said to be; what is done to them is sent.
import { svg } from './editor.js'

const KINDS = ['plane', 'box', 'sphere']
const HANDLE_KEYS = ['ArrowLeft', 'ArrowRight', 'ArrowUp', 'ArrowDown', 'PageUp', 'PageDown']
// Radii in pixels: of what is seen, and of what a finger hits. The ring of a tip is around a dot at the same place.
const RADII = { rail: [7, 14], hub: [7, 14], rim: [7, 14], tip: [15, 22] }

export function overlay (send, pace) {
  const under = KINDS.map(() => svg('path', { class: 'wvr-under-line' }))
  const over = KINDS.map((kind) => svg('path', { class: `wvr-${kind}` }))
  const handles = svg('g', {})
  const element = svg('svg', {
    class: 'wvr-overlay', role: 'group', 'aria-label': 'Handles of clips', preserveAspectRatio: 'none'
  }, svg('g', { 'aria-hidden': 'true' }, ...under, ...over), handles)
  const there = new Map()
  let held = null

  const place = (event) => {
    const box = element.getBoundingClientRect()
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]
  }
  const named = (event) => event.target.closest('.wvr-handle')

  handles.addEventListener('pointerdown', (event) => {
    if (event.button !== 0 || held !== null) return
    const handle = named(event)
    held = event.pointerId
    handle.focus({ focusVisible: false })
    handle.setPointerCapture(held)
    send({ type: 'grab', handle: handle.dataset.name, at: place(event) })
    event.preventDefault()
  })
  handles.addEventListener('pointermove', (event) => {
    if (event.pointerId === held) pace.put('pull', { type: 'pull', at: place(event) })
  })
  // However it ends, also where a handle goes out of sight.
  handles.addEventListener('lostpointercapture', () => {
    held = null
    pace.flush()
    send({ type: 'drop' })
  })
  handles.addEventListener('keydown', (event) => {
    if (!HANDLE_KEYS.includes(event.key) || event.ctrlKey || event.altKey || event.metaKey) return
    send({ type: 'nudge', handle: named(event).dataset.name, key: event.key, fine: event.shiftKey })
    event.preventDefault()
  })

  function made ({ name, kind, sort, label }) {
    const [seen, hit] = RADII[sort]
    const ring = sort === 'tip' ? [svg('circle', { class: 'wvr-ring', r: seen })] : []
    return svg('g', {
      class: `wvr-handle wvr-${sort} wvr-${kind}`, 'data-name': name, tabindex: 0, role: 'slider', 'aria-label': label
    }, svg('title', {}, label), svg('circle', { class: 'wvr-reach', r: hit }), ...ring,
    svg('circle', { class: 'wvr-dot', r: seen }))
  }

  return {
    element,
    show: (on) => element.toggleAttribute('hidden', !on),
    draw (message) {
      const { width, height } = element.getBoundingClientRect()
      const at = ([x, y]) => `${(x * width).toFixed(1)} ${(y * height).toFixed(1)}`
      element.setAttribute('viewBox', `0 0 ${width || 1} ${height || 1}`)
      KINDS.forEach((kind, index) => {
        const path = message.lines.filter(([of]) => of === kind).map(([, places]) => `M ${places.map(at).join(' L ')}`)
        for (const line of [under[index], over[index]]) line.setAttribute('d', path.join(' '))
      })
      const names = message.handles.map(({ name }) => name)
      for (const [name, handle] of there) {
        if (names.includes(name)) continue
        handle.remove()
        there.delete(name)
      }
      message.handles.forEach((handle, index) => {
        if (!there.has(handle.name)) {
          there.set(handle.name, made(handle))
          handles.insertBefore(there.get(handle.name), handles.children[index] ?? null)
        }
        const values = {
          transform: `translate(${at(handle.at)})`,
          'aria-valuemin': handle.span[0],
          'aria-valuemax': handle.span[1],
          'aria-valuenow': Number(handle.value.toFixed(4)),
          'aria-valuetext': handle.text
        }
        for (const [key, value] of Object.entries(values)) there.get(handle.name).setAttribute(key, value)
      })
    }
  }
}
