// The viewer in a notebook: the connection is that of the widget's model.
import { start } from './viewer.js'

function render ({ model, el }) {
  const root = document.createElement('div')
  el.append(root)
  const viewer = start(root, (message) => {
    try {
      model.send(message)
    } catch { /* there is no kernel */ }
  })
  const receive = (message, buffers) =>
    viewer.receive(message, buffers.length > 0 ? new Blob([buffers[0]], { type: 'image/png' }) : null)
  model.on('msg:custom', receive)
  if (model.get('still') !== '') viewer.still(model.get('still'))
  try {
    model.send({ type: 'hello' })
  } catch { /* there is no kernel */ }
  viewer.connected()
  return () => model.off('msg:custom', receive)
}

export default { render }
