"use strict";
// A click on a person says how to follow them: where it fell in the frame, from the top left, and when.
const line = document.getElementById("who");
const quoted = (text) => `'${text.replaceAll("'", `'"'"'`)}'`; // as shlex.quote has it, for a shell to take as one word
for (const picture of document.querySelectorAll("img[data-time]")) {
  picture.addEventListener("click", (event) => {
    const box = picture.getBoundingClientRect();
    const scale = Math.min(box.width / picture.naturalWidth, box.height / picture.naturalHeight); // object-fit: contain
    const share = (at, start, shown, natural) => (at - start - (shown - natural * scale) / 2) / (natural * scale);
    const x = share(event.clientX, box.left, box.width, picture.naturalWidth);
    const y = share(event.clientY, box.top, box.height, picture.naturalHeight);
    if (x < 0 || x > 1 || y < 0 || y > 1) return;
    line.textContent = quoted(`${line.dataset.clip}person=${x.toFixed(3)},${y.toFixed(3)},${picture.dataset.time}`);
    getSelection().selectAllChildren(line);
  });
}
