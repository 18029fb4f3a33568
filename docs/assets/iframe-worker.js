// Makes the search work on pages that are opened from a disk, where browsers refuse to start a worker: a hidden frame
// takes its place. The theme asks for the class by this name, and expects importScripts to return a promise.

class IFrameWorker extends EventTarget {
  constructor(url) {
    super();
    this.frame = document.createElement("iframe");
    this.frame.hidden = true;
    this.frame.srcdoc = `<body><script>
      postMessage = message => parent.postMessage(message, "*");
      importScripts = (...urls) => urls.reduce((before, url) => before.then(() => new Promise((resolve, reject) => {
        const script = document.createElement("script");
        Object.assign(script, {src: url, onload: resolve, onerror: reject});
        document.body.append(script);
      })), Promise.resolve());
    </script><script src="${url}"></script></body>`;
    this.loaded = new Promise(resolve => this.frame.addEventListener("load", resolve, {once: true}));
    window.addEventListener("message", event => {
      if (event.source === this.frame.contentWindow)
        this.dispatchEvent(new MessageEvent("message", {data: event.data}));
    });
    document.body.append(this.frame);
  }

  postMessage(message) {
    this.loaded.then(() => this.frame.contentWindow.dispatchEvent(new MessageEvent("message", {data: message})));
  }

  terminate() {
    this.frame.remove();
  }
}

if (location.protocol === "file:")
  window.Worker = window.IFrameWorker = IFrameWorker;
