// made by `make page` of page/src efbf3fc20cde66af
"use strict";(()=>{var windows=[...document.querySelectorAll("iframe")].map(frame=>frame.contentWindow),NEAR=10,world=({camera,origin})=>JSON.stringify([camera.azimuth,camera.elevation,
camera.distance,camera.flat,...camera.target.map((value,axis)=>value+origin[axis])]);function follow(viewer,state){let[azimuth,elevation,distance,flat,...target]=JSON.
parse(state);Object.assign(viewer.camera,{azimuth,elevation,distance,flat,target:target.map((value,axis)=>value-viewer.origin[axis])}),viewer.ask()}function counterpart(from,to){
let middle=({low,high},{origin})=>[0,1].map(axis=>(low[axis]+high[axis])/2+origin[axis]),spot=from.spots[from.look.chosen-1];if(!spot)return-1;let[x,y]=middle(spot,
from),away=to.spots.map(other=>Math.hypot(middle(other,to)[0]-x,middle(other,to)[1]-y)),nearest=away.indexOf(Math.min(...away));return away[nearest]<=NEAR?nearest:
-1}function begin(viewers){for(let frame of windows)frame.document.documentElement.dataset.framed="yes";viewers[0].obeyAddress(location.hash),follow(viewers[1],
world(viewers[0]));let seen=viewers.map(world),chosen=viewers.map(()=>0),kept="",step=()=>{let moved=viewers.findIndex((viewer,place)=>world(viewer)!==seen[place]);
moved>=0&&follow(viewers[1-moved],world(viewers[moved])),seen=viewers.map(world);let picked=viewers.findIndex((viewer,place)=>viewer.look.chosen!==chosen[place]);
picked>=0&&viewers[1-picked].choose(counterpart(viewers[picked],viewers[1-picked]),!1),chosen=viewers.map(viewer=>viewer.look.chosen);let address=viewers[0].address();
address!==kept&&moved<0&&history.replaceState(null,"",kept=address),requestAnimationFrame(step)};document.documentElement.dataset.ready="yes",step()}var waiting=setInterval(
()=>{let viewers=windows.map(frame=>frame.eaves);viewers.some(viewer=>!viewer)||(clearInterval(waiting),begin(viewers))},50);})();
