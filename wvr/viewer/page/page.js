// The page's connection: a socket beside it, which is tried again for as long as the page is open.
import { start } from './viewer.js'

const FIRST_PAUSE = 300
const LONGEST_PAUSE = 5000

const address = new URL('socket', window.location.href)
address.protocol = address.protocol.replace('http', 'ws')
let socket = null
let pause = FIRST_PAUSE

const viewer = start(document.getElementById('viewer'), (message) => {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message))
})

function receive (event) {
  if (typeof event.data === 'string') {
    viewer.receive(JSON.parse(event.data), null)
    return
  }
  const length = new DataView(event.data).getUint32(0)
  const header = new TextDecoder().decode(new Uint8Array(event.data, 4, length))
  viewer.receive(JSON.parse(header), new Blob([new Uint8Array(event.data, 4 + length)], { type: 'image/png' }))
}

function connect () {
  // A page that comes back from the browser's history asks at once, beside who tries again.
  if (socket !== null && socket.readyState <= WebSocket.OPEN) return
  const mine = socket = new WebSocket(address)
  socket.binaryType = 'arraybuffer'
  socket.onmessage = receive
  socket.onopen = () => {
    pause = FIRST_PAUSE
    viewer.connected()
  }
  socket.onclose = (event) => {
    if (mine !== socket) return
    viewer.disconnected(event.reason)
    window.setTimeout(connect, pause)
    pause = Math.min(2 * pause, LONGEST_PAUSE)
  }
}

window.addEventListener('pagehide', () => socket.close())
window.addEventListener('pageshow', (event) => { if (event.persisted) connect() })
connect()
